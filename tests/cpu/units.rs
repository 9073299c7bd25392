//! Coordinate systems: units, projections, degrees drawn in metres, and significant digits.
//!
//! Files are generated; real ones, also in feet, lie in `../shared`; tests that need it are skipped
//! if it is missing.

use crate::commands::info;
use crate::index_file::indexed;
use crate::made::{Las, Vlr, sheet};
use crate::program::{pointillist, succeeded, text};
use crate::shared::shared;
use glam::DVec3;
use pointillist::app::measure::{Measure, Picked};
use pointillist::cloud::crs::{self, Crs, Kind};
use pointillist::cloud::point_lookup::{self, LookupQuery};
use pointillist::cloud::{self, Cloud, ColumnSet, Header, ReadOptions};
use pointillist::index::format::Index;
use pointillist::progress::Silent;
use pointillist::render::source::Source;
use pointillist::resident::Point;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

const ALL: ReadOptions = ReadOptions::new(ColumnSet::ALL, true);

fn read(paths: &[&Path]) -> Cloud {
    let paths: Vec<PathBuf> = paths.iter().map(|path| path.to_path_buf()).collect();
    cloud::read(&paths, &ALL, &Silent).unwrap()
}

fn system_of(cloud: &Cloud) -> &Crs {
    cloud.parts[0].header.system.as_ref().expect("a system")
}

/// Opens files or an index as windows and pictures do.
fn source(path: &Path) -> Source {
    if Index::is_one(path) {
        Source::Index(Index::open(path).unwrap().into())
    } else {
        Source::Files(read(&[path]))
    }
}

fn wkt(text: &str) -> Vlr {
    ("LASF_Projection", 2112, text.bytes().chain([0]).collect())
}

const DEGREE: &str = r#"GEOGCS["NAD83",DATUM["North_American_Datum_1983",SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]"#;

/// Returns Lambert's conic of Oregon in this unit, with further nodes.
fn oregon(unit: &str, behind: &str) -> String {
    format!(
        r#"PROJCS["Oregon",{DEGREE},PROJECTION["Lambert_Conformal_Conic_2SP"],PARAMETER["standard_parallel_1",43],PARAMETER["standard_parallel_2",45.5],PARAMETER["latitude_of_origin",41.75],PARAMETER["central_meridian",-120.5],PARAMETER["false_easting",1312335.958],PARAMETER["false_northing",0],{unit}{behind}]"#
    )
}

const UTM_2: &str = r#"PROJCRS["WGS 84 / UTM zone 32N",BASEGEOGCRS["WGS 84",DATUM["World Geodetic System 1984",ELLIPSOID["WGS 84",6378137,298.257223563,LENGTHUNIT["metre",1]]],PRIMEM["Greenwich",0,ANGLEUNIT["degree",0.0174532925199433]]],CONVERSION["UTM zone 32N",METHOD["Transverse Mercator"],PARAMETER["Latitude of natural origin",0,ANGLEUNIT["degree",0.0174532925199433]],PARAMETER["Longitude of natural origin",9,ANGLEUNIT["degree",0.0174532925199433]],PARAMETER["Scale factor at natural origin",0.9996,SCALEUNIT["unity",1]],PARAMETER["False easting",500000,LENGTHUNIT["US survey foot",0.304800609601219]],PARAMETER["False northing",0,LENGTHUNIT["metre",1]]],CS[Cartesian,2],AXIS["(E)",east,ORDER[1],LENGTHUNIT["US survey foot",0.304800609601219]],AXIS["(N)",north,ORDER[2],LENGTHUNIT["US survey foot",0.304800609601219]],ID["EPSG",32632]]"#;

/// Returns GeoTIFF keys with their values.
fn geotiff(keys: &[(u16, u16)]) -> Vlr {
    let head = [1, 1, 0, keys.len() as u16];
    let all = head.into_iter().chain(keys.iter().flat_map(|&(key, value)| [key, 0, 1, value]));
    ("LASF_Projection", 34735, all.flat_map(u16::to_le_bytes).collect())
}

/// Returns the sheet, 20 units wide, in Oregon.
fn made(vlrs: Vec<Vlr>) -> Las {
    Las { vlrs, offset: [636_000.0, 849_000.0, 400.0], scale: [0.01; 3], ..Las::default() }
}

/// A name, records, and their meaning: unit, EPSG code, and unit of heights if different.
type Case = (&'static str, Vec<Vlr>, Option<&'static str>, Option<u32>, Option<&'static str>);

#[test]
fn units_are_those_of_text_and_of_keys() {
    let folder = tempfile::tempdir().unwrap();
    let foot = r#"UNIT["foot",0.3048,AUTHORITY["EPSG","9002"]]"#;
    let survey = r#"UNIT["US survey foot",0.3048006096012192]"#;
    let height =
        r#",VERT_CS["NAVD88",VERT_DATUM["x",2005],UNIT["US survey foot",0.3048006096012192]]]"#;
    let cases: Vec<Case> = vec![
        (
            "wkt1",
            vec![wkt(&oregon(foot, r#",AUTHORITY["EPSG","2992"]"#))],
            Some("ft"),
            Some(2992),
            None,
        ),
        (
            "esri",
            vec![wkt(&oregon(r#"UNIT["Foot_US",0.3048006096012192]"#, ""))],
            Some("ftUS"),
            None,
            None,
        ),
        ("named", vec![wkt(&oregon(r#"UNIT["metre"]"#, ""))], Some("m"), None, None),
        ("wkt2", vec![wkt(UTM_2)], Some("ftUS"), Some(32632), None),
        (
            "compound",
            vec![wkt(&format!("COMPD_CS[\"both\",{}{height}", oregon(survey, "")))],
            Some("ftUS"),
            None,
            None,
        ),
        (
            "mixed",
            vec![wkt(&format!("COMPD_CS[\"both\",{}{height}", oregon(r#"UNIT["metre",1]"#, "")))],
            Some("m"),
            None,
            Some("ftUS"),
        ),
        (
            "keys",
            vec![geotiff(&[(1024, 1), (3072, 2903), (3076, 9003)])],
            Some("ftUS"),
            Some(2903),
            None,
        ),
        // The unit is that of the system with this number.
        ("code", vec![geotiff(&[(1024, 1), (3072, 2992)])], Some("ft"), Some(2992), None),
        ("metres", vec![geotiff(&[(1024, 1), (3072, 32632)])], Some("m"), Some(32632), None),
        // Text is preferred to keys.
        (
            "both",
            vec![geotiff(&[(1024, 1), (3072, 32632)]), wkt(&oregon(foot, ""))],
            Some("ft"),
            None,
            None,
        ),
        ("none", vec![geotiff(&[(1024, 1), (3072, 32767)])], None, None, None),
    ];
    for (name, vlrs, unit, epsg, height) in cases {
        let path = made(vlrs).write(folder.path(), &format!("{name}.las"));
        let cloud = read(&[&path]);
        let system = system_of(&cloud);
        assert_eq!(
            (system.unit.as_ref().map(|unit| unit.symbol()), system.epsg, system.kind),
            (unit, epsg, Kind::Projected),
            "{name}"
        );
        assert_eq!(system.height_unit.as_ref().map(|unit| unit.symbol()), height, "{name}");
        assert_eq!(
            cloud.notes.iter().any(|note| note.contains("times as steep as they are")),
            height.is_some(),
            "{name}: {:?}",
            cloud.notes
        );
        let index = indexed(&[&path], "");
        let (of_files, of_index) = (info(&[&path], ""), info(&[&index], ""));
        for said in [&of_files, &of_index] {
            assert_eq!(said["parts"][0]["header"]["system"], json!(system), "{name}");
            assert_eq!(said["unit_is_stated"], json!(unit.is_some()), "{name}");
        }
        assert_eq!(of_files["notes"], of_index["notes"], "{name}");
    }
    // Behind the points, since a header of 65,535 bytes has no room for it.
    let behind = Las {
        minor: 4,
        format: 6,
        evlrs: vec![("other", 1, vec![7; 100]), wkt(&oregon(foot, ""))],
        ..made(vec![])
    };
    let cloud = read(&[&behind.write(folder.path(), "behind.las")]);
    assert_eq!(system_of(&cloud).unit().symbol(), "ft");
    assert!(
        read(&[&made(vec![]).write(folder.path(), "nothing.las")]).parts[0].header.system.is_none()
    );
    assert!(
        read(&[&made(vec![wkt("PROJCS[")]).write(folder.path(), "cut.las")]).parts[0]
            .header
            .system
            .is_none()
    );
}

/// Returns two points as the window picks them.
fn picked(source: &Source, places: [DVec3; 2]) -> Measure {
    let points = places
        .map(|position| {
            Picked::new(Point { position, exact: true, color: [0; 3], value: None, kind: None })
        })
        .to_vec();
    Measure { points, reference: source.reference() }
}

#[test]
fn measures_in_feet_have_metres_beside() {
    let folder = tempfile::tempdir().unwrap();
    let path =
        made(vec![wkt(&oregon(r#"UNIT["foot",0.3048]"#, ""))]).write(folder.path(), "feet.las");
    for path in [path.clone(), indexed(&[&path], "")] {
        let measure = picked(
            &source(&path),
            [DVec3::new(636_000.0, 849_000.0, 400.0), DVec3::new(636_300.0, 849_400.0, 400.0)],
        );
        let said = measure.to_string();
        assert!(said.contains("distance 500.0000 ft (152.4000 m), height 0.0000 ft (0.0000 m), horizontal 500.0000 ft"), "{said}");
        let csv = measure.csv();
        let mut rows = csv.lines();
        assert!(rows.next().unwrap().ends_with(",unit,x_m,y_m,z_m"), "{csv}");
        assert!(rows.next().unwrap().ends_with(",ft,193852.8,258775.2,121.92"), "{csv}");
        let json = measure.geojson();
        let facts = &json["features"][0]["properties"];
        assert_eq!((&facts["length"], &facts["unit"]), (&json!(500.0), &json!("ft")));
        assert!((facts["length_m"].as_f64().unwrap() - 152.4).abs() < 1e-9);
        // Compared with PROJ: a test from text to longitude and latitude.
        let place = json["features"][0]["geometry"]["coordinates"][0].as_array().unwrap();
        let [lon, lat, height] = [0, 1, 2].map(|i| place[i].as_f64().unwrap());
        assert!(
            (lon - -123.0734).abs() < 1e-3
                && (lat - 44.0501).abs() < 1e-3
                && (height - 121.92).abs() < 1e-9,
            "{lon} {lat} {height}"
        );
        assert_eq!(json["coordinate_system"]["unit"]["name"], "foot");
        assert!(json["note"].is_null());
    }
    let text_of = |name: &str, vlrs| {
        let path = made(vlrs).write(folder.path(), name);
        let output = pointillist().arg("info").arg(path).output().unwrap();
        succeeded(&output);
        text(&output.stdout)
    };
    let feet = text_of(
        "a.las",
        vec![wkt(&oregon(r#"UNIT["foot",0.3048]"#, r#",AUTHORITY["EPSG","2992"]"#))],
    );
    assert!(
        feet.contains("Oregon (EPSG:2992), projected, in foot (0.3048 m)")
            && feet.contains(" ft ("),
        "{feet}"
    );
    assert!(text_of("b.las", vec![]).contains("metre, assumed: no file states it"));
}

#[test]
fn geojson_of_an_unknown_system_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let local = r#"LOCAL_CS["site",UNIT["metre",1]]"#;
    let own = made(vec![wkt(local)]).write(folder.path(), "local.las");
    let ends = [DVec3::new(636_000.0, 849_000.0, 400.0), DVec3::new(636_003.0, 849_004.0, 400.0)];
    let json = picked(&source(&own), ends).geojson();
    assert_eq!(
        json["features"][0]["geometry"]["coordinates"][1],
        json!([636_003.0, 849_004.0, 400.0])
    );
    assert!(json["note"].as_str().unwrap().contains("site, local, in metre"), "{json}");
    // A number without a known projection is still reported to other programs.
    let coded = made(vec![wkt(&local.replace("]]", r#"],AUTHORITY["EPSG","5800"]]"#))])
        .write(folder.path(), "coded.las");
    assert_eq!(
        picked(&source(&coded), ends).geojson()["crs"]["properties"]["name"],
        "urn:ogc:def:crs:EPSG::5800"
    );
    let silent = made(vec![]).write(folder.path(), "silent.las");
    let json = picked(&source(&silent), ends).geojson();
    assert!(json["note"].as_str().unwrap().contains("that no file names"), "{json}");
}

/// Returns degrees beside metres: about equally many over 20 m, at this corner.
fn angular(lon: f64, lat: f64) -> Las {
    let text = format!("{}]", DEGREE.trim_end_matches(']').to_owned() + "]");
    Las {
        minor: 4,
        format: 6,
        vlrs: vec![wkt(&text)],
        scale: [1e-8, 1e-8, 0.001],
        offset: [lon, lat, 0.0],
        points: sheet(|_| [0; 3])
            .into_iter()
            .map(|p| crate::made::Point { q: [p.q[0], p.q[1], p.q[2]], ..p })
            .collect(),
        ..Las::default()
    }
}

/// Returns the distance of two near places along the ellipsoid, by the middle latitude (Bowring
/// 1981).
fn apart([lon1, lat1]: [f64; 2], [lon2, lat2]: [f64; 2]) -> f64 {
    let (a, e2) = (6_378_137.0, 0.006_694_379_990_14);
    let middle = ((lat1 + lat2) / 2.0_f64).to_radians();
    let w = (1.0_f64 - e2 * middle.sin().powi(2)).sqrt();
    let east = a / w * middle.cos() * (lon2 - lon1).to_radians();
    let north = a * (1.0 - e2) / w.powi(3) * (lat2 - lat1).to_radians();
    east.hypot(north)
}

#[test]
fn degrees_are_drawn_on_a_plane_in_metres_in_memory_and_through_an_index() {
    let folder = tempfile::tempdir().unwrap();
    for (name, lon, lat) in [("a.las", -94.0, 31.0), ("b.laz", 13.4, 78.2), ("c.las", 174.8, -41.3)]
    {
        let made = angular(lon, lat);
        let path = made.write(folder.path(), name);
        let cloud = read(&[&path]);
        let plane = system_of(&cloud).plane.expect("a plane");
        assert!(
            cloud.notes.iter().any(|note| note.contains("degrees, drawn in metres")),
            "{:?}",
            cloud.notes
        );
        let part = &cloud.parts[0];
        let place = |i: usize| {
            part.lattice
                .world([part.columns.x[i], part.columns.y[i], part.columns.z[i]].map(i64::from))
        };
        let degrees = |i: usize| {
            [lon + made.points[i].q[0] as f64 * 1e-8, lat + made.points[i].q[1] as f64 * 1e-8]
        };
        for (i, j) in [(0, 1), (17, 4000), (2500, 4999)] {
            let (own, right) =
                ((place(i) - place(j)).truncate().length(), apart(degrees(i), degrees(j)));
            assert!((own / right - 1.0).abs() < 1e-6, "{name}: {own} {right}");
            let back = plane.lonlat(place(i));
            assert!((0..2).all(|axis| (back[axis] - degrees(i)[axis]).abs() < 1e-12), "{name}");
            assert!((place(i).z - made.points[i].q[2] as f64 * 0.001).abs() < 1e-9);
        }
        let index = indexed(&[&path], "");
        let (of_files, of_index) = (info(&[&path], ""), info(&[&index], ""));
        assert_eq!(of_files["notes"], of_index["notes"]);
        for key in ["header", "step", "offset"] {
            assert_eq!(of_files["parts"][0][key], of_index["parts"][0][key], "{key}");
        }
        let corners = |said: &Value| {
            ["min", "max"]
                .map(|end| serde_json::from_value::<DVec3>(said["bounds"][end].clone()).unwrap())
        };
        let [lo, hi] = corners(&of_files);
        assert!(
            (corners(&of_index)[0] - lo).abs().max_element() < 1e-3
                && (hi - lo).max_element() < 30.0,
            "{lo} {hi}"
        );
        // A picked point is found in the file at its position.
        let sought = LookupQuery { position: place(17), ..LookupQuery::default() };
        let found = point_lookup::find(std::slice::from_ref(&path), ALL, &sought, &Silent)
            .unwrap()
            .expect("the point");
        assert_eq!((found.point, found.extras.user_data), (17, Some(0)));
        let json = picked(&source(&index), [place(17), place(18)]).geojson();
        let at: [f64; 3] =
            serde_json::from_value(json["features"][0]["geometry"]["coordinates"][0].clone())
                .unwrap();
        assert!(
            (at[0] - degrees(17)[0]).abs() < 1e-9 && (at[1] - degrees(17)[1]).abs() < 1e-9,
            "{at:?}"
        );
    }
}

#[test]
fn files_in_degrees_share_a_plane_and_others_are_said_to_differ() {
    let folder = tempfile::tempdir().unwrap();
    let west = angular(-94.0, 31.0).write(folder.path(), "west.las");
    let east = angular(-93.999, 31.0).write(folder.path(), "east.las");
    let cloud = read(&[&west, &east]);
    let planes: Vec<_> =
        cloud.parts.iter().map(|part| part.header.system.as_ref().unwrap().plane).collect();
    assert_eq!(planes[0], planes[1]);
    let corner = |part: usize| cloud.parts[part].bounds().unwrap().0;
    let right = apart([-94.0, 31.0], [-93.999, 31.0]);
    assert!(((corner(1) - corner(0)).x - right).abs() < 0.1, "{} {right}", corner(1) - corner(0));
    let plain = made(vec![]).write(folder.path(), "plain.las");
    let feet =
        made(vec![wkt(&oregon(r#"UNIT["foot",0.3048]"#, ""))]).write(folder.path(), "feet.las");
    let said = |paths: &[&Path], what: &str| {
        let notes = read(paths).notes;
        assert!(notes.iter().any(|note| note.contains(what)), "{notes:?}");
    };
    said(&[&west, &plain], "drawn on a local plane, the others are not");
    said(&[&plain, &feet], "different units (metre, foot)");
}

#[test]
fn strays_do_not_move_a_plane_and_what_are_no_degrees_stay_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let mut stray = angular(10.0, 50.0);
    stray.points[9].q = [-1_000_000_000, i32::MIN, 0];
    stray.scale[1] = 1e-7;
    stray
        .points
        .iter_mut()
        .filter(|point| point.q[1] > i32::MIN)
        .for_each(|point| point.q[1] /= 10);
    let middle =
        |las: &Las, name: &str| system_of(&read(&[&las.write(folder.path(), name)])).plane.unwrap();
    let (own, with) = (middle(&angular(10.0, 50.0), "a.las"), middle(&stray, "b.las"));
    assert!((own.latitude - with.latitude).abs() < 1e-5, "{own} {with}");
    let lying = Las { vlrs: angular(0.0, 0.0).vlrs, ..made(vec![]) };
    let path = lying.write(folder.path(), "lying.las");
    assert!(
        cloud::read(std::slice::from_ref(&path), &ALL, &Silent)
            .unwrap_err()
            .to_string()
            .contains("as degrees, but are not degrees")
    );
    let cloud = cloud::read(&[path], &ReadOptions { strict: false, ..ALL }, &Silent).unwrap();
    assert!(
        cloud
            .notes
            .iter()
            .any(|note| note.contains("are declared as degrees, but are not degrees")),
        "{:?}",
        cloud.notes
    );
    assert_eq!(cloud.parts[0].lattice.offset.x, 636_000.0);
    // A header with a wrong box.
    let mut bytes = angular(10.0, 50.0).bytes();
    bytes[179..227].fill(0);
    let path = folder.path().join("box.las");
    std::fs::write(&path, bytes).unwrap();
    let cloud =
        cloud::read(std::slice::from_ref(&path), &ReadOptions { strict: false, ..ALL }, &Silent)
            .unwrap();
    assert_eq!(system_of(&cloud).plane.unwrap(), own);
}

/// Floats of angles and metres get a lattice as fine as each needs; readers mark columns of angles.
#[test]
fn a_table_whose_columns_are_longitude_and_latitude_is_drawn_in_metres() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("places.csv");
    let rows = (0..1000).map(|i| {
        format!(
            "{:.7},{:.7},{:.2}\n",
            47.0 + (i % 40) as f64 * 1e-5,
            8.0 + (i / 40) as f64 * 1e-5,
            400.0 + (i % 3) as f64
        )
    });
    std::fs::write(&path, format!("lat,lon,height\n{}", rows.collect::<String>())).unwrap();
    let cloud = read(&[&path]);
    let (lo, hi) = cloud.bounds().unwrap();
    // A degree of latitude is 111.17 km there, one of longitude 76.06 km.
    assert!(
        ((hi - lo) - DVec3::new(24e-5 * 76_060.0, 39e-5 * 111_170.0, 2.0)).abs().max_element()
            < 0.05,
        "{}",
        hi - lo
    );
    assert!(cloud.notes.iter().any(|note| note.contains("degrees")), "{:?}", cloud.notes);
}

#[test]
fn an_e57_in_degrees_and_facts_that_say_it() {
    use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.e57");
    let mut writer = E57Writer::from_file(&path, "file").unwrap();
    writer.set_coordinate_metadata(Some(DEGREE.into()));
    let record = |name| Record { name, data_type: RecordDataType::Double { min: None, max: None } };
    let names = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ];
    let mut scan = writer.add_pointcloud("scan", names.map(record).to_vec()).unwrap();
    let places: Vec<[f64; 3]> = sheet(|_| [0; 3])
        .iter()
        .map(|p| [7.0 + p.q[0] as f64 * 1e-8, 47.0 + p.q[1] as f64 * 1e-8, p.q[2] as f64])
        .collect();
    places
        .iter()
        .for_each(|place| scan.add_point(place.map(RecordValue::Double).to_vec()).unwrap());
    scan.finalize().unwrap();
    writer.finalize().unwrap();
    let cloud = read(&[&path]);
    let (part, plane) = (&cloud.parts[0], system_of(&cloud).plane.unwrap());
    for (i, place) in places.iter().enumerate() {
        let own = part
            .lattice
            .world([part.columns.x[i], part.columns.y[i], part.columns.z[i]].map(i64::from));
        let [lon, lat] = plane.lonlat(own);
        assert!(
            (lon - place[0]).abs() < 1e-11
                && (lat - place[1]).abs() < 1e-11
                && (own.z - place[2]).abs() < 1e-4,
            "{own}"
        );
    }
    let said = |what: &str, text: &str| {
        Crs::of(&Header { facts: vec![(what.into(), text.into())], ..Header::default() })
    };
    assert_eq!(said(crs::DEGREES.0, crs::DEGREES.1), Some(Crs::degrees()));
    assert_eq!(said("columns", "lat lon alt"), Some(Crs::degrees()));
    assert_eq!(
        (said("columns", "x y z"), said("comment", "lat lon"), said("columns", "late long")),
        (None, None, None)
    );
}

#[test]
fn coordinates_have_the_digits_of_their_lattice() {
    let folder = tempfile::tempdir().unwrap();
    let mut hundredths = made(vec![]);
    hundredths.points[0].q = [0, 2, 8];
    let path = hundredths.write(folder.path(), "a.las");
    for path in [path.clone(), indexed(&[&path], "")] {
        let said = info(&[&path], "");
        for corner in ["min", "max"] {
            for v in said["bounds"][corner].as_array().unwrap() {
                let decimals =
                    v.to_string().split_once('.').map_or(0, |(_, decimals)| decimals.len());
                assert!(decimals <= 2, "{v} of {}", path.display());
            }
        }
        let place = read(&[&folder.path().join("a.las")]).parts[0].lattice.world([7, 8, 29]);
        let measure = picked(&source(&path), [place; 2]);
        assert!(
            measure.to_string().starts_with("point 2: 636000.07 849000.08 400.29"),
            "{measure}"
        );
        assert!(measure.csv().lines().nth(1).unwrap().starts_with("636000.07,849000.08,400.29,"));
        assert_eq!(
            measure.geojson()["features"][0]["geometry"]["coordinates"][0],
            json!([636_000.07, 849_000.08, 400.29])
        );
    }
}

#[test]
fn files_that_people_have_met_have_their_units() {
    let (Some(cases), Some(data)) = (shared("cases"), shared("data")) else { return };
    let cloud = read(&[&cases.join("latlon_wkt.las")]);
    let (lo, hi) = cloud.bounds().unwrap();
    assert!((hi - lo).truncate().abs_diff_eq(glam::DVec2::new(200.9, 199.6), 1.0), "{}", hi - lo);
    assert_eq!(system_of(&cloud).epsg, Some(4326));
    for (name, unit, epsg, [lon, lat]) in [
        ("aerial/autzen_trim.laz", "ft", None, [-123.07, 44.05]),
        ("aerial/4_6_crop.las", "ftUS", Some(2903), [-107.8, 35.0]),
        ("formats/las1.4_pf6.las", "ftUS", None, [-106.07, 35.99]),
        ("aerial/bcts_1.laz", "m", Some(3005), [-123.0, 49.5]),
        ("aerial/ign_rgb16_nir_697k.laz", "m", None, [2.0, 46.0]),
        ("ground/UAS_Clip.laz", "m", None, [-111.0, 35.0]),
        ("formats/las1.0_pf0.las", "m", Some(26915), [-93.35, 41.57]),
    ] {
        let paths = [data.join(name)];
        let cloud = cloud::read(&paths, &ReadOptions { strict: false, ..ALL }, &Silent).unwrap();
        let system = system_of(&cloud);
        let (lo, hi) = cloud.bounds().unwrap();
        let [own_lon, own_lat] = system.lonlat((lo + hi) / 2.0).unwrap_or([f64::NAN; 2]);
        println!("{name}: {system}, {:?}, {own_lon:.5} {own_lat:.5}", system.unit);
        assert_eq!(system.unit().symbol(), unit, "{name}");
        assert!(epsg.is_none() || system.epsg == epsg, "{name}: {:?}", system.epsg);
        assert!(
            (own_lon - lon).abs() < 8.0 && (own_lat - lat).abs() < 8.0,
            "{name}: {own_lon} {own_lat}"
        );
    }
}
