//! Single features of tables: headings, units, gaps, options.

use super::{ALL, read, read_as, refused, says, world};
use glam::DVec3;
use pointillist::cloud::table::{Columns, Delimiter, TextOptions};
use pointillist::cloud::{Cloud, ColumnSet, Extra, ReadOptions};

fn points(cloud: &Cloud) -> Vec<[f64; 3]> {
    world(cloud).iter().map(DVec3::to_array).collect()
}

#[test]
fn two_meanings_are_an_error_that_shows_both() {
    let error = refused("a.csv", "500000,5,5000000,25,100,75\n500001,5,5000001,25,101,75\n");
    for part in [
        "line 1",
        "500000,5,5000000,25,100,75",
        "500000 5 5000000",
        "500000.5 5000000.25 100.75",
        "--delimiter",
    ] {
        assert!(error.contains(part), "{error}");
    }
    // One of them contradicts the line.
    let cloud = read("b.csv", "x,y,z\n500000,5,5000000,25,100,75\n");
    assert_eq!(points(&cloud), [[500000.5, 5000000.25, 100.75]]);
    assert!(says(&cloud, "decimal commas"), "{:?}", cloud.notes);
    let cloud = read("c.csv", "x,y,z,r,g,b\n1,5,5,25,100,75\n");
    assert_eq!(points(&cloud), [[1.0, 5.0, 5.0]]);
    // No fraction is below 0, and no integer is written as 05.
    assert_eq!(points(&read("d.csv", "1,-5,5,25,100,75\n")), [[1.0, -5.0, 5.0]]);
    assert_eq!(points(&read("e.csv", "1,05,5,25,100,75\n")), [[1.05, 5.25, 100.75]]);
    // One name fewer than fields, as in tables with numbered rows.
    let error = refused("f.txt", "x y z\n1 0.5 0.6 0.7\n2 1.5 1.6 1.7\n");
    assert!(
        error.contains("line 1 names 3 columns, but rows have 4 fields")
            && error.contains("--columns"),
        "{error}"
    );
    let error = refused("g.csv", "x,y,intensity\n1,2,3\n");
    assert!(error.contains("names x and y, but not all"), "{error}");
}

fn with(columns: Option<&str>, delimiter: Option<&str>) -> ReadOptions {
    let text = TextOptions {
        columns: columns.map(|text| text.parse::<Columns>().unwrap()),
        delimiter: delimiter.map(|text| text.parse::<Delimiter>().unwrap()),
        scalar: None,
    };
    ReadOptions { text, ..ALL }
}

#[test]
fn columns_that_are_no_part_of_a_point_are_attributes_of_their_own() {
    let text = "x,y,z,Planarity (0.1),name,depth\n1,2,3,0.25,a,\n2,3,4,-0.5,b,7\n3,4,5,0.75,c,9\n";
    let options = ReadOptions { extras: true, ..ALL };
    let cloud = read_as("a.csv", text.as_bytes(), &options).unwrap();
    let extra = |name: &str, min: f64, max: f64, missing: u64| Extra {
        name: name.into(),
        min: Some(min),
        max: Some(max),
        missing,
    };
    assert_eq!(
        cloud.parts[0].header.extras,
        [extra("Planarity (0.1)", -0.5, 0.75, 0), extra("depth", 7.0, 9.0, 1)]
    );
    assert!(says(&cloud, "text that is not kept: \"name\""), "{:?}", cloud.notes);
    // One of them is intensity if requested, also by a name as other programs write it.
    for name in ["Planarity (0.1)", "scalar_planarity", "column 4"] {
        let scalar = ReadOptions {
            text: TextOptions { scalar: Some(name), ..TextOptions::NONE },
            ..options
        };
        let read = read_as(
            "a.csv",
            text.replace(
                "Planarity (0.1)",
                if name == "column 4" { "" } else { "Planarity (0.1)" },
            )
            .as_bytes(),
            &scalar,
        );
        let part = &read.unwrap_or_else(|error| panic!("{error}")).parts[0];
        assert_eq!(
            (part.intensity_range, part.columns.intensity.as_deref()),
            ([-0.5, 0.75], Some(&[39321, 0, 65535][..])),
            "{name}"
        );
        assert_eq!(part.header.extras.len(), 1);
    }
    for (name, why) in [
        ("none", "it has x, y, z, Planarity (0.1), name, depth"),
        ("name", "it is text"),
        ("x", "it is a coordinate"),
    ] {
        let scalar = ReadOptions {
            text: TextOptions { scalar: Some(name), ..TextOptions::NONE },
            ..options
        };
        let error = read_as("a.csv", text.as_bytes(), &scalar).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    }
}

#[test]
fn strictly_nothing_is_guessed_and_nothing_is_lost() {
    let strictly = |text: &str, columns: Option<&str>| {
        let options = ReadOptions { strict: true, ..with(columns, None) };
        read_as("a.txt", text.as_bytes(), &options)
            .map(|cloud| cloud.len())
            .map_err(|error| error.to_string())
    };
    for (text, why) in [
        ("1 2 3 40\n2 3 4 50\n", "could be x y z intensity"),
        ("x,y,z,name\n1,2,3,a\n2,3,4,b\n", "not kept: \"name\""),
        ("a,b,c,intensity\n1,2,3,4\n2,3,4,5\n", "names no x, y and z in line 1"),
    ] {
        let error = strictly(text, None).unwrap_err();
        assert!(error.contains(why) && error.contains("--columns"), "{error}");
        assert_eq!(strictly(text, Some("x,y,z,-")), Ok(2));
    }
    assert_eq!(strictly("1 2 3\n2 3 4\n", None), Ok(2));
    assert_eq!(strictly("x,y,z,planarity\n1,2,3,0.5\n2,3,4,0.5\n", None), Ok(2));
}

#[test]
fn decimals_stay_the_decimals_they_are() {
    let cloud = read(
        "a.xyz",
        "500000.001 5000000.25 97.5\n500019.999 5000019.998 103\n500007.5 5000001 98\n",
    );
    let part = &cloud.parts[0];
    assert_eq!(
        (part.lattice.step, part.lattice.offset),
        (DVec3::splat(0.001), DVec3::new(500000.001, 5000000.25, 97.5))
    );
    assert_eq!(part.columns.x, [0, 19998, 7499]);
    // Steps are powers of two if that loses nothing, and if there are more digits than steps.
    assert_eq!(read("b.xyz", "0.5 0.25 0\n1 2 3\n").parts[0].lattice.step, DVec3::splat(0.25));
    let many = read("c.xyz", "0.123456789012345 0 0\n1000 1 1\n");
    assert_eq!(many.parts[0].lattice.step.x.log2().fract(), 0.0);
}

#[test]
fn what_is_asked_for_is_not_found_out() {
    let ambiguous = b"500000,5,5000000,25,100,75\n";
    let read = |bytes: &[u8], options: ReadOptions| {
        read_as("a.txt", bytes, &options).unwrap_or_else(|error| panic!("{error}"))
    };
    assert_eq!(points(&read(ambiguous, with(None, Some(",")))), [[500000.0, 5.0, 5000000.0]]);
    assert_eq!(
        points(&read(ambiguous, with(Some("x,y,z"), None))),
        [[500000.5, 5000000.25, 100.75]]
    );
    assert_eq!(
        points(&read(ambiguous, with(Some("x,y,z,r,g,b"), None))),
        [[500000.0, 5.0, 5000000.0]]
    );
    let cloud = read(b"z y x\n3 2 1 9 200 100 50\n", with(Some("x,y,z,-,red,green,blue"), None));
    assert_eq!(points(&cloud), [[3.0, 2.0, 1.0]]);
    assert_eq!(cloud.parts[0].columns.rgb, Some(vec![[200, 100, 50]]));
    assert!(
        cloud.parts[0].columns.intensity.is_none()
            && says(&cloud, "columns as asked for: x y z - red green blue"),
        "{:?}",
        cloud.notes
    );
    let cloud = read(b"id;x;y;z\n1;1,5;2,5;3,5\n", with(Some("-,y,x,z"), Some(";")));
    assert_eq!(points(&cloud), [[2.5, 1.5, 3.5]]);
    let error =
        read_as("a.txt", b"1 2 3\n", &with(Some("x,y,z,intensity"), None)).unwrap_err().to_string();
    assert!(error.contains("4 columns that were asked for") && error.contains("1 2 3"), "{error}");
    for wrong in ["x,y", "x,y,z,w", "x,y,z,x", ""] {
        assert!(wrong.parse::<Columns>().is_err(), "{wrong}");
    }
    assert!("|".parse::<Delimiter>().is_err());
}

#[test]
fn names_are_known_whatever_stands_around_them() {
    let cloud = read("a.txt", "Point ID X [m] Y [m] Z [m] Gps Time\n7 1 2 3 1000.5\n");
    assert_eq!(points(&cloud), [[1.0, 2.0, 3.0]]);
    assert_eq!(cloud.parts[0].columns.gps_time, Some(vec![1000.5]));
    assert!(
        cloud.parts[0]
            .header
            .facts
            .contains(&("names".into(), "Point ID, X [m], Y [m], Z [m], Gps Time".into()))
    );
    // Latin-1, a directive of Excel, a line of units, row numbers without a name.
    let latin = b"sep=;\nRechtswert;Hochwert;H\xF6he\nm;m;m\n1,5;2,5;3,5\n";
    let cloud = read_as("b.csv", latin, &ALL).unwrap();
    assert_eq!(points(&cloud), [[1.5, 2.5, 3.5]]);
    assert!(says(&cloud, "2 lines before them passed over"), "{:?}", cloud.notes);
    assert_eq!(
        points(&read("c.csv", ",x,y,z\n0,1,2,3\n1,4,5,6\n")),
        [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    );
    // Comments may be anything.
    let cloud = read("d.txt", "# x y z of an old church\n1 2 3 10 20 30\n");
    assert_eq!(points(&cloud), [[1.0, 2.0, 3.0]]);
    assert!(
        says(
            &cloud,
            "columns are taken as x y z red green blue; line 1 names 7 columns, but rows have 6"
        ),
        "{:?}",
        cloud.notes
    );
    let cloud = read("e.csv", "# x y z r g b\n1,2,3,10,20,30\n");
    assert!(says(&cloud, "by their names in line 1"), "{:?}", cloud.notes);
    let cloud = read("f.csv", "a,b,c,intensity\n1,2,3,7\n4,5,6,9\n");
    assert_eq!(
        (points(&cloud)[1], cloud.parts[0].columns.intensity.clone()),
        ([4.0, 5.0, 6.0], Some(vec![7, 9]))
    );
    assert!(says(&cloud, "no x, y and z among the names in line 1"), "{:?}", cloud.notes);
    // Text of several words, separated by blanks.
    assert_eq!(read("g.txt", "1 2 3 a tree\n4 5 6 grass\n7 8 9 a big tree\n").len(), 3);
}

#[test]
fn lines_that_are_no_rows_are_counted_and_the_first_is_shown() {
    let text =
        "x y z i\r\n1 2 3 4\r\n# remark\r\n\r\n1 2 3\r\n5 6 7 8 9\r\n1 two 3 4\r\n4 5 6 -\r\n";
    let cloud = read("a.txt", text);
    assert_eq!(points(&cloud), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert!(
        says(&cloud, "3 lines are not points and were skipped; line 5: \"1 2 3\": 3 fields, not 4"),
        "{:?}",
        cloud.notes
    );
    assert!(
        says(&cloud, "1 line without a value for \"i\", the first is line 8"),
        "{:?}",
        cloud.notes
    );
    let error = read_as("a.txt", text.as_bytes(), &ReadOptions::new(ColumnSet::ALL, true))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("line 5 is not a row of the table: \"1 2 3\": 3 fields, not 4"),
        "{error}"
    );
    // Missing values of a line that is not a row are not counted.
    let cloud = read("gaps.csv", "x,y,z,i,class\n1,2,3,,5\n4,5,6,\n-1.7e38,0,0,,1\n7,8,9,1,2\n");
    assert!(
        says(&cloud, "1 line without a value for \"i\", the first is line 2"),
        "{:?}",
        cloud.notes
    );
    // Also in a later block.
    let mut long: String = (0..700_000).map(|i| format!("{i}.25 {} -7\n", i % 1000)).collect();
    long += "one two three\n1 2 3\n";
    let cloud = read("long.xyz", &long);
    assert!(says(&cloud, "line 700001: \"one two three\""), "{:?}", cloud.notes);
    // A damaged first row is not a heading.
    let cloud = read("b.xyz", "1.2.3 4 5\n6 7 8\n");
    assert!(
        says(&cloud, "1 line is not a point and was skipped; line 1: \"1.2.3 4 5\""),
        "{:?}",
        cloud.notes
    );
    assert!(says(&read("c.xyz", "a church\n6 7 8\n"), "1 line before them passed over"));
}

#[test]
fn coordinates_that_stand_for_none_are_left_out() {
    let cloud = read(
        "a.xyz",
        "1 2 3\n-1.70141E+38 -1.70141E+38 -1.70141E+38\n4 5 -3.4028234663852886e+38\n1e38 1 1\n7 8 9\n1e30 0 0\n",
    );
    assert_eq!(cloud.len(), 3);
    assert!(
        says(
            &cloud,
            "3 lines without data (coordinates such as -1.70141E+38) were skipped, the first is line 2"
        ),
        "{:?}",
        cloud.notes
    );
}

#[test]
fn counts_are_held_against_what_is_there() {
    let blocks = "2\n1 2 3 -500 10 20 30\n4 5 6 700 40 50 60\n1\n7 8 9 0 70 80 90\n";
    let cloud = read("a.pts", blocks);
    assert_eq!(points(&cloud), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
    let part = &cloud.parts[0];
    assert_eq!((part.header.format.as_str(), part.header.points), ("PTS", Some(3)));
    assert_eq!(part.columns.rgb.as_ref().unwrap()[2], [70, 80, 90]);
    // Integers are kept, counted from the least.
    assert_eq!(
        (part.intensity_range, part.columns.intensity.clone()),
        ([-500.0, 65035.0], Some(vec![0, 1200, 500]))
    );
    // The readings of the table and its colours; nothing about counts.
    assert_eq!(cloud.notes.len(), 2, "{:?}", cloud.notes);
    let cloud = read("a.txt", &blocks.replace("1\n7", "5\n7"));
    assert!(says(&cloud, "count lines declare 7 points, 3 could be read"), "{:?}", cloud.notes);
}

const PTX: &str = "2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n100 200 300 1\n1 0 0 0.5\n0 0 0 0.5\n0 2 0 0.25\n0 0 3 1\n";

#[test]
fn ptx_scans_stand_where_their_matrices_say() {
    let second = PTX
        .replace("100 200 300", "0 0 7")
        .replace("1 0 0 0.5\n0 0 0", "1 0 0 0.5 255 0 9\n0 0 0")
        .lines()
        .collect::<Vec<_>>()
        .join("\r\n");
    let second = second
        .replace("0 0 0 0.5", "0 0 0 0.5 0 0 0")
        .replace("0 2 0 0.25", "0 2 0 0.25 1 2 3")
        .replace("0 0 3 1", "0 0 3 1 4 5 6");
    for name in ["a.ptx", "a.txt", "a.xyz", "a.csv", "a.asc", "a.pts"] {
        let cloud = read(name, &format!("{PTX}{second}\r\n"));
        assert_eq!(cloud.parts.len(), 2, "{:?}", cloud.notes);
        // A quarter turn about z: x is y, and y is -x.
        let places = [
            [100.0, 201.0, 300.0],
            [98.0, 200.0, 300.0],
            [100.0, 200.0, 303.0],
            [0.0, 1.0, 7.0],
            [-2.0, 0.0, 7.0],
            [0.0, 0.0, 10.0],
        ];
        assert_eq!(points(&cloud), places);
        assert_eq!(cloud.parts[0].header.format, "PTX");
        assert_eq!(
            cloud.stations.iter().map(|station| (station.part, station.points)).collect::<Vec<_>>(),
            [(0, 3), (1, 3)]
        );
        assert_eq!(cloud.parts[1].columns.rgb, Some(vec![[255, 0, 9], [1, 2, 3], [4, 5, 6]]));
        assert_eq!(cloud.parts[0].columns.intensity, Some(vec![32768, 16384, 65535]));
        assert!(says(&cloud, "scan 1: 1 of 4 directions hit nothing"), "{:?}", cloud.notes);
    }
    let cut = &PTX[..PTX.len() - 8];
    let cloud = read("cut.ptx", cut);
    assert_eq!(cloud.len(), 2);
    assert!(says(&cloud, "says 4 lines, and has 3"), "{:?}", cloud.notes);
    // With a line missing or too many, the next scan is found where it begins.
    let missing = PTX.replace("0 2 0 0.25\n", "") + PTX;
    let cloud = read("missing.ptx", &missing);
    assert_eq!((cloud.parts.len(), cloud.len()), (2, 5), "{:?}", cloud.notes);
    assert!(says(&cloud, "scan 1: says 4 lines, and has 3"), "{:?}", cloud.notes);
    let many = PTX.replace("0 2 0 0.25\n", "0 2 0 0.25\n0 2 0 0.5\n") + PTX;
    let cloud = read("many.ptx", &many);
    assert_eq!((cloud.parts.len(), cloud.len()), (2, 7), "{:?}", cloud.notes);
    let strict = ReadOptions::new(ColumnSet::ALL, true);
    assert!(
        [missing, many].iter().all(|text| read_as("odd.ptx", text.as_bytes(), &strict).is_err())
    );
    for end in ["\n", "\r\n", "\r"] {
        let cloud = read("rest.ptx", &format!("{PTX}1 2 3 4\n5 6 7 8\n").replace('\n', end));
        let what = "line 15 should begin scan 2, but reads \"1 2 3 4\"; the rest was skipped";
        assert!(says(&cloud, what), "{:?}", cloud.notes);
    }
}

#[test]
fn what_other_text_files_are_is_said() {
    assert!(
        refused("a.asc", "ncols 4\nnrows 2\nxllcorner 0\n1 2 3 4\n5 6 7 8\n")
            .contains("grid of heights")
    );
    let utf16: Vec<u8> = "1 2 3\n4 5 6\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let error = read_as("a.txt", &utf16, &ALL).unwrap_err().to_string();
    assert!(error.contains("UTF-16 without a byte order mark"), "{error}");
    assert!(refused("a.xyz", "nothing here\n").contains("\"nothing here\""));
    // The x of an integer in front is not a coordinate of two that follow a blank: this is not a
    // table with commas.
    assert!(
        refused("b.txt", "1 2 3,4,5,6\n7 8 9,1,2,3\n")
            .contains("no rows of at least three numbers")
    );
}

#[test]
fn decimal_commas_of_ply() {
    let header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let cloud = read("a.ply", &format!("{header}1,5 2,25 -3,125\n4 5 6\n"));
    assert_eq!(points(&cloud), [[1.5, 2.25, -3.125], [4.0, 5.0, 6.0]]);
    assert!(says(&cloud, "decimal commas"), "{:?}", cloud.notes);
    assert_eq!(
        points(&read("b.ply", &format!("{header}1,2,3\n4,5,6\n"))),
        [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    );
    assert_eq!(read("c.obj", "v 1,5 2,5 3,5\n").len(), 0);
}
