//! Column names of common programs to roles, ignoring case, units and separators.

use super::{Role, word};

/// Roles and their names without separators. If several columns match a role, the name listed first
/// wins.
const NAMES: &[(Role, &[&str])] = &[
    (
        Role::Position(0),
        &[
            "x",
            "easting",
            "east",
            "e",
            "xcoordinate",
            "xcoord",
            "coordinatex",
            "coordx",
            "pointx",
            "positionx",
            "posx",
            "cartesianx",
            "points0",
            "pointsx",
            "rechtswert",
            "longitude",
            "lon",
            "long",
            "lng",
        ],
    ),
    (
        Role::Position(1),
        &[
            "y",
            "northing",
            "north",
            "n",
            "ycoordinate",
            "ycoord",
            "coordinatey",
            "coordy",
            "pointy",
            "positiony",
            "posy",
            "cartesiany",
            "points1",
            "pointsy",
            "hochwert",
            "latitude",
            "lat",
        ],
    ),
    (
        Role::Position(2),
        &[
            "z",
            "elevation",
            "elev",
            "altitude",
            "alt",
            "height",
            "h",
            "zcoordinate",
            "zcoord",
            "coordinatez",
            "coordz",
            "pointz",
            "positionz",
            "posz",
            "cartesianz",
            "points2",
            "pointsz",
            "ellipsoidalheight",
            "orthometricheight",
            "höhe",
            "hoehe",
        ],
    ),
    (
        Role::Color(0),
        &["red", "r", "colorred", "colorr", "redcolor", "rgbr", "diffusered", "rf", "redf"],
    ),
    (
        Role::Color(1),
        &[
            "green",
            "g",
            "colorgreen",
            "colorg",
            "greencolor",
            "rgbg",
            "diffusegreen",
            "gf",
            "greenf",
        ],
    ),
    (
        Role::Color(2),
        &["blue", "b", "colorblue", "colorb", "bluecolor", "rgbb", "diffuseblue", "bf", "bluef"],
    ),
    (Role::Normal(0), &["nx", "normalx", "xnormal", "normx"]),
    (Role::Normal(1), &["ny", "normaly", "ynormal", "normy"]),
    (Role::Normal(2), &["nz", "normalz", "znormal", "normz"]),
    (
        Role::Intensity,
        &[
            "intensity",
            "i",
            "int",
            "intens",
            "intensities",
            "reflectance",
            "amplitude",
            "remission",
            "signalstrength",
            "returnintensity",
        ],
    ),
    (
        Role::Class,
        &["classification", "class", "classificationcode", "classid", "classcode", "label"],
    ),
    (
        Role::Return,
        &[
            "returnnumber",
            "returnnr",
            "returnno",
            "returnnum",
            "return",
            "echonumber",
            "echonr",
            "targetindex",
        ],
    ),
    (
        Role::Returns,
        &[
            "numberofreturns",
            "numreturns",
            "returnsnumber",
            "returncount",
            "nreturns",
            "returns",
            "numberofechoes",
            "targetcount",
        ],
    ),
    (Role::Source, &["pointsourceid", "sourceid", "pointsource", "psid", "source"]),
    (
        Role::Time,
        &["gpstime", "time", "timestamp", "gpstimestamp", "adjustedgpstime", "gpsseconds", "t"],
    ),
];

/// Names of colours as fractions of 1.
pub const FRACTIONS: &[&str] = &["rf", "gf", "bf", "redf", "greenf", "bluef"];

/// Units without brackets behind a name, as in `x_m`.
const UNITS: &[&str] = &[
    "m", "mm", "cm", "km", "ft", "us", "deg", "degrees", "db", "s", "sec", "ns", "metres",
    "meters", "feet",
];

/// Normalises a name: lower case, no unit, no separators, no `scalar_` of CloudCompare.
pub fn normalized(name: &str) -> String {
    let name = name
        .trim_matches(|c: char| {
            c.is_whitespace() || matches!(c, '"' | '\'' | '/' | '#' | '%' | '\u{feff}')
        })
        .to_lowercase();
    let bare = match name.find(['[', '(']) {
        Some(at) if at > 0 => &name[..at],
        _ => &name,
    };
    let mut words: Vec<&str> =
        bare.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    if words.len() > 1 && words[0] == "scalar" {
        words.remove(0);
    }
    if words.len() > 1 && words.last().is_some_and(|word| UNITS.contains(word)) {
        words.pop();
    }
    words.concat()
}

/// Returns the role of a column name, if known.
pub fn role(name: &str) -> Option<Role> {
    ranked(name).map(|(role, _)| role)
}

fn ranked(name: &str) -> Option<(Role, usize)> {
    let name = normalized(name);
    NAMES
        .iter()
        .find_map(|(role, names)| Some((*role, names.iter().position(|known| *known == name)?)))
}

/// Returns the roles of columns with these names, each role once, and triples only if complete: `b`
/// alone is not blue.
pub fn roles<'a>(names: impl Iterator<Item = &'a str>) -> Vec<Role> {
    let ranked: Vec<Option<(Role, usize)>> = names.map(ranked).collect();
    let is_best = |place: usize, (role, rank): (Role, usize)| {
        let others =
            ranked.iter().enumerate().filter_map(|(other, found)| Some((other, (*found)?)));
        others
            .filter(|(_, (other, _))| *other == role)
            .map(|(other, (_, rank))| (rank, other))
            .min()
            == Some((rank, place))
    };
    let is_whole = |role: Role| {
        let has = |wanted: Role| ranked.iter().flatten().any(|(role, _)| *role == wanted);
        match role {
            Role::Color(_) => (0..3).map(Role::Color).all(has),
            Role::Normal(_) => (0..3).map(Role::Normal).all(has),
            _ => true,
        }
    };
    let role = |(place, found): (usize, &Option<(Role, usize)>)| {
        found
            .filter(|&found| is_whole(found.0) && is_best(place, found))
            .map_or(Role::Other, |(role, _)| role)
    };
    ranked.iter().enumerate().map(role).collect()
}

/// Lists all roles for messages.
pub fn listed() -> String {
    NAMES.iter().map(|(role, _)| word(*role)).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_case_and_marks_do_not_matter() {
        for name in [
            "X", "x [m]", "X(m)", "//X", "\"X\"", "x_m", "Easting", "Points:0", " LON ", "scalar_x",
        ] {
            assert_eq!(role(name), Some(Role::Position(0)), "{name}");
        }
        for (name, expected) in [
            ("Reflectance (dB)", Role::Intensity),
            ("scalar_Classification", Role::Class),
            ("GPSTime", Role::Time),
            ("Gps Time [s]", Role::Time),
            ("ReturnNumber", Role::Return),
            ("Number_of_returns", Role::Returns),
            ("PointSourceId", Role::Source),
            ("Rf", Role::Color(0)),
            ("normal_z", Role::Normal(2)),
        ] {
            assert_eq!(role(name), Some(expected), "{name}");
        }
        for name in ["Point ID", "Illuminance (PCV)", "Volume density (r=0.01)", "", "xy"] {
            assert_eq!(role(name), None, "{name}");
        }
    }

    #[test]
    fn of_two_columns_for_one_role_the_better_named_counts() {
        let names = ["lat", "lon", "height", "x", "y", "z", "Amplitude", "Reflectance", "x"];
        let expected = [
            Role::Other,
            Role::Other,
            Role::Other,
            Role::Position(0),
            Role::Position(1),
            Role::Position(2),
            Role::Other,
            Role::Intensity,
            Role::Other,
        ];
        assert_eq!(roles(names.into_iter()), expected);
    }
}
