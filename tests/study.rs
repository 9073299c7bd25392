//! The precision study, tiny: what its files promise to whoever reads them.

mod gpu;

use gpu::Way;
use pointillist::progress::Silent;
use pointillist::study::{self, Plan, Row, report};
use std::collections::BTreeMap;

const PLAN: Plan = Plan { points: 20_000, seed: 1, repeat: 3, size: [64, 64] };

#[test]
fn the_precision_study_keeps_its_promises() {
    let folder = tempfile::tempdir().unwrap();
    let rows = gpu::with(Way::Compute64, |gpu| {
        let sections = study::run(&["precision".into()], gpu, &PLAN, &Silent).unwrap();
        report::write(folder.path(), &sections, &PLAN, &report::Origin::here(gpu)).unwrap();
        sections.into_iter().next().unwrap().rows
    });
    csv_holds_exactly(&std::fs::read_to_string(folder.path().join("precision.csv")).unwrap(), &rows);
    errors_fall_as_bits_rise(&rows);
    fronts_are_fronts(&rows);
    let page = std::fs::read_to_string(folder.path().join("study.html")).unwrap();
    // Names of namespaces are no links; anything that a browser would fetch is.
    for fetched in ["<link", "<script", "<img", "src=", "@import", "url(", "href=\"http"] {
        assert!(!page.contains(fetched), "study.html fetches {fetched}");
    }
    let pictures = std::fs::read_dir(folder.path())
        .unwrap()
        .filter(|entry| entry.as_ref().unwrap().path().extension().is_some_and(|e| e == "svg"))
        .count();
    assert_eq!((pictures, page.matches("<svg").count()), (6, 6));
    assert!(["device", "driver", "commit", "seed", "command"].iter().all(|fact| page.contains(&format!("<th>{fact}</th>"))));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 8, "nothing half written is left");
}

fn csv_holds_exactly(text: &str, rows: &[Row]) {
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("study,scene,view,knob,value,metric,error,ms_median,ms_q1,ms_q3,n,auto,front,device"));
    // Three scenes, three views, four settings, six metrics.
    assert_eq!((rows.len(), lines.clone().count()), (216, 216));
    for (line, row) in lines.zip(rows) {
        let fields: Vec<&str> = line.splitn(14, ',').collect();
        assert_eq!(fields[..6], ["precision", row.scene, row.view, "bits", &row.value, row.metric]);
        let numbers: Vec<f64> = fields[6..10].iter().map(|field| field.parse().unwrap()).collect();
        assert_eq!(numbers, [row.error, row.ms[1], row.ms[0], row.ms[2]]);
        assert!(row.error >= 0.0 && row.ms[0] > 0.0 && row.ms[0] <= row.ms[1] && row.ms[1] <= row.ms[2], "{row:?}");
        assert_eq!(fields[10..13], ["3".to_string(), (row.value == "auto").to_string(), row.front.to_string()]);
        assert!(fields[13].len() > 2);
    }
}

fn groups(rows: &[Row]) -> BTreeMap<(&str, &str, &str), Vec<&Row>> {
    let mut groups: BTreeMap<_, Vec<&Row>> = BTreeMap::new();
    rows.iter().for_each(|row| groups.entry((row.scene, row.view, row.metric)).or_default().push(row));
    groups
}

/// 10 bits are worst, visibly so from near; more bits are better down to what f32 arithmetic leaves, 12 u f pixels (HARD_CASES 1.2): f is at most 64 px / (2 tan 20 degrees) = 88 px here,
/// and the depths are below 10 km, where the same 12 u are 7 mm.
fn errors_fall_as_bits_rise(rows: &[Row]) {
    let u = 2f64.powi(-24);
    for ((scene, view, metric), rows) in groups(rows) {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        if metric == "bytes_read" {
            // Four bytes a point and plane.
            assert!(error("10") <= error("20") && error("20") <= error("all") && error("auto") <= error("all"), "{scene} {view}");
            assert!(error("10") > 0.0 && error("10") % 4.0 == 0.0, "{scene} {view}");
            continue;
        }
        let floor = match metric {
            "px_max" | "px_rms" => 12.0 * u * 88.0,
            "m_max" | "m_rms" => 12.0 * u * 1e4,
            _ => {
                assert_eq!(error("all"), 0.0, "{scene} {view}: the picture at full precision is its own reference");
                0.0
            }
        };
        let at = format!("{scene} {view} {metric}: {} {} {} auto {}", error("10"), error("20"), error("all"), error("auto"));
        assert!(error("10") + floor >= error("20") && error("20") + floor >= error("all") && error("10") + floor >= error("auto"), "{at}");
        if metric == "px_max" && view == "close-up" {
            assert!(error("10") > 0.5, "10 bits do not fail visibly: {at}");
            // What auto promises of quantisation, beside the floor; in a corner of this picture a point is 1.25 times as far from the eye as it is deep.
            assert!(error("auto") <= 1.25 / 4096.0 + floor, "{at}");
        }
    }
}

/// By the definition itself, apart from the code that marked them.
fn fronts_are_fronts(rows: &[Row]) {
    for (group, rows) in groups(rows) {
        for row in &rows {
            let beaten = rows.iter().any(|other| {
                let no_worse = other.error <= row.error && other.ms[1] <= row.ms[1];
                no_worse && (other.error < row.error || other.ms[1] < row.ms[1])
            });
            assert_eq!(row.front, !beaten, "{group:?} {}", row.value);
        }
        assert!(rows.iter().any(|row| row.front), "{group:?} has no front");
    }
}

#[test]
fn a_study_that_there_is_not_names_those_that_there_are() {
    let error = gpu::with(Way::Compute64, |gpu| study::run(&["speed".into()], gpu, &PLAN, &Silent).err().unwrap().to_string());
    assert!(error.contains("speed") && error.contains("precision"), "{error}");
}
