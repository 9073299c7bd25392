//! Pages of reports, as a browser shows them.

use crate::browser::look;
use pointillist::study::report::{self, Origin, Section, Table};
use pointillist::study::{Plan, Row, mark_fronts};

const PLAN: Plan = Plan {
    points: 1000,
    seed: 1,
    repeat: 3,
    size: [64, 48],
    scenes: Vec::new(),
    files: Vec::new(),
};

fn origin() -> Origin {
    Origin {
        device: "A <device>".into(),
        driver: "1".into(),
        is_cpu: true,
        commit: None,
        command: "study".into(),
    }
}

/// Returns settings in heaps, at zero and far from each other, in three scenes.
fn rows() -> Vec<Row> {
    let mut rows = Vec::new();
    for (place, scene) in ["plain", "zeros", "heap"].into_iter().enumerate() {
        for k in 0..24 {
            let near = 1.0 + 1e-3 * f64::from(k);
            let (ms, error) = match place {
                0 => (1.4f64.powi(k), 1e3 * 0.5f64.powi(k)),
                1 => (f64::from(k % 5), f64::from(k % 3) * 1e-9),
                _ => (near, 2.0 - near),
            };
            rows.push(Row {
                scene,
                view: "far",
                parameter: "knob",
                value: format!("a long value of number {k}"),
                metric: "error",
                error,
                ms: [ms * 0.9, ms, ms * 1.2],
                n: 3,
                auto: k == 11,
                front: false,
            });
        }
    }
    mark_fronts(&mut rows);
    rows
}

fn section(rows: Vec<Row>) -> Section {
    let label = |row: &Row| if row.auto { "auto".into() } else { row.value.clone() };
    let axes = ["milliseconds of a whole frame", "relative error of depth, median"];
    let of = |title: &str, rows: &[Row]| report::chart("error", axes, title, rows, &label);
    let charts = vec![of("All scenes", &rows), of("One scene </script>", &rows[..24])];
    let head = vec!["a".into(), "b".into()];
    let table = Table { title: "others".into(), head, rows: vec![vec!["1".into(), "<i>".into()]] };
    Section {
        name: "made",
        title: "Made up".into(),
        method: "It is not.".into(),
        rows,
        charts,
        tables: vec![table],
    }
}

#[test]
fn labels_stand_apart_and_marks_within_their_panels() {
    let folder = tempfile::tempdir().unwrap();
    report::write(folder.path(), &[section(rows())], &PLAN, &origin()).unwrap();
    for width in [1100, 500] {
        let Some(found) = look(&folder.path().join("study.html"), width) else { return };
        for wrong in ["errors", "overlaps", "outside", "wide"] {
            assert_eq!(found[wrong].as_array().unwrap().len(), 0, "{width}: {:#}", found[wrong]);
        }
        // Two charts, and three scenes of the first one apart.
        assert_eq!(found["panels"], 5);
        for labels in found["labels"].as_array().unwrap() {
            let labels = labels.as_array().unwrap();
            assert!(labels.len() >= 2 && labels.iter().any(|name| name == "auto"), "{labels:?}");
        }
    }
}

#[test]
fn a_page_is_one_file_and_says_where_its_numbers_are_from() {
    let page = report::html(&[section(rows())], &PLAN, &origin());
    let own = page.split("<!-- D3").next().unwrap();
    // Names of namespaces are not links; anything that a browser would fetch is.
    for fetched in ["<link", "<img", "src=", "@import", "url(", "href=\"http"] {
        assert!(!own.contains(fetched), "the page fetches {fetched}");
    }
    for fact in ["device", "driver", "commit", "seed", "command"] {
        assert!(own.contains(&format!("<th>{fact}</th>")), "{fact} is missing");
    }
    assert!(own.contains("A &lt;device&gt;, commit unknown") && own.contains("&lt;i&gt;"));
    assert!(page.contains("Copyright 2010-2023 Mike Bostock"), "the licence is missing");
    assert!(page.contains("Observable, Inc."), "the licence is missing");
}
