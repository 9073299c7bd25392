//! The studies, tiny: what their files promise to whoever reads them.

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
    // Three scenes, three views, four settings, six metrics.
    csv_holds_exactly(&std::fs::read_to_string(folder.path().join("precision.csv")).unwrap(), &rows, ["precision", "bits", "auto"], 216);
    assert!(rows.iter().all(|row| row.n == 3));
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

fn csv_holds_exactly(text: &str, rows: &[Row], [study, knob, auto]: [&str; 3], count: usize) {
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("study,scene,view,knob,value,metric,error,ms_median,ms_q1,ms_q3,n,auto,front,device"));
    assert_eq!((rows.len(), lines.clone().count()), (count, count));
    for (line, row) in lines.zip(rows) {
        let fields: Vec<&str> = line.splitn(14, ',').collect();
        assert_eq!(fields[..6], [study, row.scene, row.view, knob, &row.value, row.metric]);
        let numbers: Vec<f64> = fields[6..10].iter().map(|field| field.parse().unwrap()).collect();
        assert_eq!(numbers, [row.error, row.ms[1], row.ms[0], row.ms[2]]);
        assert!(row.error >= 0.0 && row.ms[0] > 0.0 && row.ms[0] <= row.ms[1] && row.ms[1] <= row.ms[2], "{row:?}");
        assert_eq!(fields[10..13], [row.n.to_string(), (row.value == auto).to_string(), row.front.to_string()]);
        assert!(fields[13].len() > 2);
    }
}

/// Runs one study into a folder: its rows, the text of its CSV, and how many figures there are.
fn made(name: &str, plan: &Plan) -> (Vec<Row>, String, usize) {
    let folder = tempfile::tempdir().unwrap();
    let rows = gpu::with(Way::Compute64, |gpu| {
        let sections = study::run(&[name.into()], gpu, plan, &Silent).unwrap();
        report::write(folder.path(), &sections, plan, &report::Origin::here(gpu)).unwrap();
        sections.into_iter().next().unwrap().rows
    });
    let page = std::fs::read_to_string(folder.path().join("study.html")).unwrap();
    (rows, std::fs::read_to_string(folder.path().join(format!("{name}.csv"))).unwrap(), page.matches("<svg").count())
}

#[test]
fn the_lod_study_keeps_its_promises() {
    let plan = Plan { points: 150_000, seed: 1, repeat: 2, size: [128, 96] };
    let (mut rows, text, figures) = made("lod", &plan);
    // Two scenes, seven settings; three views with nine metrics, one dolly with two.
    csv_holds_exactly(&text, &rows, ["lod", "lod", "auto"], 2 * 7 * (3 * 9 + 2));
    assert_eq!(figures, 10);
    // More dB are better: their front is that of the RMS errors that they are logarithms of.
    for (psnr, rms) in rows.iter().filter(|row| row.metric == "psnr_db").zip(rows.iter().filter(|row| row.metric == "rms")) {
        assert_eq!((psnr.scene, psnr.view, &psnr.value, psnr.front), (rms.scene, rms.view, &rms.value, rms.front));
        assert!((psnr.error + 20.0 * rms.error.log10()).abs() < 1e-9 || rms.error == 0.0 && psnr.error == f64::INFINITY);
    }
    rows.retain(|row| row.metric != "psnr_db");
    fronts_are_fronts(&rows);
    let mut deepest = 0f64;
    for ((scene, view, metric), rows) in groups(&rows) {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        let falling = ["8", "4", "2", "1", "0.5", "0.25"].map(error);
        let at = format!("{scene} {view} {metric}: {falling:?} auto {}", error("auto"));
        match metric {
            "points" | "bytes_read" => {
                assert!(falling.is_sorted() && error("auto") <= error("1") && falling[0] > 0.0, "{at}");
                let budget = 2.0 * (plan.size[0] * plan.size[1]) as f64;
                assert!(metric != "points" || error("auto") <= budget.max(falling[0]), "{at}");
            }
            // A tenth, and a pixel in a thousand: which of two points is nearer is chance.
            "rms" | "flip" | "holes" => {
                assert!(falling.windows(2).all(|pair| pair[1] <= 1.1 * pair[0] + 1e-3), "{at}");
                assert!(error("auto") >= 0.9 * error("1") - 1e-3, "{at}");
                deepest = if view == "far" { deepest.max(falling[0]) } else { deepest };
            }
            "popping_max" => assert!(falling.iter().all(|&max| max > 0.0 && max < 1.0), "{at}"),
            _ => {}
        }
    }
    assert!(deepest > 0.05, "the far views cut nothing");
}

/// Leaves of LAS input are equal to it (HARD_CASES 29); with fewer planes a point is drawn from the middle of its cell, of at most 2^30 / 2^(10 k) steps.
#[test]
fn the_index_study_keeps_its_promises() {
    let (rows, text, figures) = made("index", &Plan { points: 100_000, ..PLAN });
    // Three scenes, three settings; three metrics, and three views with two.
    csv_holds_exactly(&text, &rows, ["index", "bits", "all"], 3 * 3 * (3 + 3 * 2));
    assert_eq!(figures, 5);
    fronts_are_fronts(&rows);
    for ((scene, view, metric), rows) in groups(&rows) {
        let error = |value: &str| rows.iter().find(|row| row.value == value).unwrap().error;
        let at = format!("{scene} {view} {metric}: {} {} {}", error("10"), error("20"), error("all"));
        if metric == "bytes_point" {
            assert!(error("10") == 4.0 && error("20") <= 8.0 && error("all") <= 12.0, "{at}");
            continue;
        }
        assert!(error("all") == 0.0 && error("20") <= error("10") / 512.0 && error("10") > 0.0, "{at}");
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
