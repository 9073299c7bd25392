//! Files of known contents.

use super::{ALL, says};
use crate::shared::shared;
use glam::DVec3;
use pointillist::cloud;
use pointillist::progress::Silent;
use std::process::Command;

/// A file, its points, their bounds, and the required notes.
type Case = (&'static str, u64, [[f64; 3]; 2], &'static [&'static str]);

const CASES: &[Case] = &[
    (
        "riegl.csv",
        3000,
        [[0.015, 0.004, -2.992], [19.992, 20.0, 2.998]],
        &[
            "intensity \"Reflectance (dB)\"",
            "further attributes, one of which --scalar reads as intensity: \"Point ID\"",
        ],
    ),
    (
        "cc_full.txt",
        3000,
        [[0.015, 0.004, -2.992], [19.992, 20.0, 2.998]],
        &["red \"Rf\"", "nz \"Nz\"", "\"Illuminance (PCV)\""],
    ),
    (
        "units_head.csv",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["x \"X [m]\"", "blue \"B\""],
    ),
    (
        "comma_semi.csv",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["between semicolons, decimal commas"],
    ),
    (
        "comma_space.xyz",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["between spaces, decimal commas"],
    ),
    ("deccomma.ply", 4000, [[0.001, 0.001, 97.0], [19.999, 19.998, 103.0]], &["decimal commas"]),
    (
        "blank_mid.csv",
        3000,
        [[0.003, 0.008, -2.997], [19.996, 19.999, 2.998]],
        &["2000 lines without a value for \"intensity\""],
    ),
    (
        "bom_nohead.xyz",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["taken as x y z"],
    ),
    (
        "hexwords.csv",
        4000,
        [[500000.001, 5000000.001, 97.0], [500019.999, 5000019.998, 103.0]],
        &["text that is not kept: \"label\""],
    ),
    (
        "name_first.csv",
        3000,
        [[0.003, 0.008, -2.997], [19.996, 19.999, 2.998]],
        &["text that is not kept: \"name\""],
    ),
    (
        "latlon_named.csv",
        3000,
        [[500000.007, 5000000.016, -2.992], [500019.993, 5000020.0, 2.999]],
        &["x \"lon\"", "y \"lat\""],
    ),
    (
        "two_as.txt",
        3600,
        [[500000.0021, 5000000.0053, 97.0024], [500049.9888, 5000019.9936, 103.0]],
        &["200 of 2000 directions hit nothing", "read as PTX"],
    ),
    (
        "nodata.xyz",
        40,
        [[-4.43177, -4.81295, 0.126597], [4.12488, 4.40649, 2.97934]],
        &["1 line without data", "line 41"],
    ),
];

#[test]
fn files_of_other_programs_have_their_values() {
    for (name, points, bounds, words) in CASES {
        let Some(path) = shared(&format!("cases/{name}")) else { return };
        let cloud = cloud::read(&[path], &ALL, &Silent).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(cloud.len(), *points, "{name}");
        let (lo, hi) = cloud.bounds().unwrap();
        for (read, known) in [lo, hi].into_iter().zip(bounds) {
            assert!(
                (read - DVec3::from_array(*known)).abs().max_element() < 2e-6,
                "{name}: {read} {known:?}"
            );
        }
        words.iter().for_each(|words| {
            assert!(says(&cloud, words), "{name}: no word of {words:?}: {:?}", cloud.notes)
        });
        // Decimals are kept.
        assert!(!says(&cloud, "are rounded"), "{name}: {:?}", cloud.notes);
        let columns = &cloud.parts[0].columns;
        match *name {
            "riegl.csv" => assert_eq!(cloud.parts[0].intensity_range, [-19.5, -0.5]),
            "cc_full.txt" => {
                assert!(columns.rgb.as_ref().unwrap().iter().all(|rgb| *rgb == [204, 102, 51]));
                assert!(
                    columns.normal.as_ref().unwrap().iter().all(|normal| *normal == [0, 76, 102])
                );
            }
            "units_head.csv" => assert_eq!(columns.rgb.as_ref().unwrap()[0], [103, 85, 17]),
            "blank_mid.csv" => {
                assert!(columns.rgb.as_ref().unwrap().iter().all(|rgb| *rgb == [200, 100, 50]));
                assert_eq!(columns.intensity.as_ref().unwrap()[0], 2499);
            }
            "two_as.txt" => assert_eq!(cloud.stations.len(), 2),
            _ => {}
        }
    }
}

fn program(words: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_pointillist")).args(words).output().unwrap()
}

/// Reads tables with `info`, `index` and `render`.
#[test]
fn the_program_reads_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    for (name, points, _, words) in CASES {
        let Some(path) = shared(&format!("cases/{name}")) else { return };
        let path = path.to_str().unwrap();
        let info = program(&["info", "--json", path]);
        let report: serde_json::Value =
            serde_json::from_slice(&info.stdout).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(report["points"], *points, "{name}");
        let index = at("index.pnti");
        let made = program(&["index", path, "-o", &index]);
        let drawn = program(&["render", path, "-o", &at("picture.png"), "--size", "64x48"]);
        for (what, output) in [("index", made), ("render", drawn)] {
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(output.status.success(), "{what} {name}: {said}");
            words.iter().for_each(|words| {
                assert!(said.contains(words), "{what} {name}: no word of {words:?}: {said}")
            });
        }
        let info = program(&["info", "--json", &index]);
        let indexed: serde_json::Value =
            serde_json::from_slice(&info.stdout).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(indexed["points"], *points, "{name}");
    }
}

#[test]
fn columns_and_delimiters_are_options_of_what_reads_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    std::fs::write(at("a.csv"), "1,5,2,5,3,5\n4,5,5,5,6,5\n").unwrap();
    let refused = program(&["info", &at("a.csv")]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("two meanings"));
    let lists: [&[&str]; 3] = [
        &["info", "--json", &at("a.csv"), "--columns", "x,y,z"],
        &["index", &at("a.csv"), "-o", &at("a.pnti"), "--columns", "x,y,z"],
        &["render", &at("a.csv"), "-o", &at("a.png"), "--size", "64x48", "--columns", "x,y,z"],
    ];
    for words in lists {
        let output = program(words);
        assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    let info = program(&["info", "--json", &at("a.pnti")]);
    let indexed: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(indexed["bounds"]["max"], serde_json::json!([4.5, 5.5, 6.5]));
    assert!(program(&["info", &at("a.csv"), "--delimiter", ","]).status.success());
    assert_eq!(program(&["info", &at("a.csv"), "--columns", "x,y"]).status.code(), Some(2));
    assert_eq!(program(&["info", &at("a.csv"), "--delimiter", "|"]).status.code(), Some(2));
}
