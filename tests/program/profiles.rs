//! A device that has what a profile of Vulkan has, and no more, draws the same bytes, or is refused
//! with the name of what it lacks, without a word of the validation layers.
//!
//! Khronos' layer of profiles, below validation, simulates a mobile device and old ones of desktops
//! where it is installed.

use crate::files::{names, scan};
use crate::lesser_devices::drawn;
use crate::program::{failed, succeeded, text};
use crate::skip::skip;
use pointillist::synth::SceneKind;
use std::path::{Path, PathBuf};

const MANIFEST: &str = "VkLayer_khronos_profiles.json";
const LAYERS: &str = "VK_LAYER_KHRONOS_validation:VK_LAYER_KHRONOS_profiles";

/// Folders of manifests, as the loader has them.
const FOLDERS: [&str; 4] = [
    "/etc/vulkan/explicit_layer.d",
    "/usr/local/etc/vulkan/explicit_layer.d",
    "/usr/local/share/vulkan/explicit_layer.d",
    "/usr/share/vulkan/explicit_layer.d",
];

/// Folder of profiles beside that of manifests, as Vulkan's SDK has it.
const PROFILES: &str = "../config/VK_LAYER_KHRONOS_profiles";
const OWN_PROFILES: &str = "VK_KHRONOS_PROFILES_PROFILE_DIRS";

/// A mobile profile, what all devices of their version have, and desktops, oldest first.
const NAMES: [&str; 5] = [
    "VP_ANDROID_baseline_2022",
    "VP_LUNARG_minimum_requirements_1_3",
    "VP_LUNARG_desktop_baseline_2022",
    "VP_LUNARG_desktop_baseline_2024",
    "VP_KHR_roadmap_2022",
];

/// Capabilities that are simulated, and features of a device that a profile does not name: none, or
/// its own.
const SIMULATED: [(&str, &str); 3] = [
    (
        "SIMULATE_API_VERSION_BIT,SIMULATE_FEATURES_BIT,SIMULATE_PROPERTIES_BIT,\
         SIMULATE_EXTENSIONS_BIT,SIMULATE_FORMATS_BIT,SIMULATE_QUEUE_FAMILY_PROPERTIES_BIT",
        "DEFAULT_FEATURE_VALUES_FALSE",
    ),
    ("SIMULATE_FEATURES_BIT,SIMULATE_PROPERTIES_BIT", "DEFAULT_FEATURE_VALUES_FALSE"),
    ("SIMULATE_FEATURES_BIT,SIMULATE_PROPERTIES_BIT", "DEFAULT_FEATURE_VALUES_DEVICE"),
];

/// Returns the folders of a variable of the environment.
fn folders_of(variable: &str) -> Vec<PathBuf> {
    std::env::var_os(variable).map(|of| std::env::split_paths(&of).collect()).unwrap_or_default()
}

/// Returns the files of profiles in a folder and those in it.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut all: Vec<PathBuf> = entries
        .flat_map(|entry| match entry.path() {
            path if path.is_dir() => files(&path),
            path => vec![path],
        })
        .filter(|path| path.extension().is_some_and(|kind| kind == "json"))
        .collect();
    all.sort();
    all
}

/// Returns whether a file has a profile of this name.
fn has(path: &Path, name: &str) -> bool {
    let profiles: Option<serde_json::Value> =
        std::fs::read(path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
    profiles.is_some_and(|file| file["profiles"][name].is_object())
}

#[test]
fn devices_of_profiles_draw_the_same_or_are_refused_by_name() {
    let mut folders = folders_of("VK_LAYER_PATH");
    folders.extend(folders_of("VK_ADD_LAYER_PATH"));
    folders.extend(FOLDERS.map(PathBuf::from));
    let Some(layer) = folders.iter().find(|folder| folder.join(MANIFEST).exists()) else {
        return skip(&format!("{MANIFEST}, Khronos' layer of profiles, is in no folder of layers"));
    };
    let mut profiles: Vec<PathBuf> =
        folders_of(OWN_PROFILES).iter().flat_map(|folder| files(folder)).collect();
    profiles.extend(files(&layer.join(PROFILES)));

    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    scan(&place.join("a.las"), SceneKind::Street, 20_000);
    let given = names(place);
    // Layers that are found first are nearest to the program.
    let mut path: Vec<PathBuf> = folders.clone();
    path.retain(|folder| folder != layer);
    path.push(layer.clone());
    let path = std::env::join_paths(path).unwrap().into_string().unwrap();

    let lines = ["a.las", "a.las --effect shadows=on --opacity class:2=0.5"];
    let expected = lines.map(|line| {
        let (output, expected) = drawn(place, line, &[]);
        succeeded(&output);
        expected
    });
    let (mut same, mut refused) = (0, Vec::new());
    for name in NAMES {
        let Some(file) = profiles.iter().find(|file| has(file, name)) else {
            skip(&format!("no file of profiles has {name}; {OWN_PROFILES} names their folder"));
            continue;
        };
        for (line, expected) in lines.iter().zip(&expected) {
            for (simulated, others) in SIMULATED {
                let variables = [
                    ("VK_INSTANCE_LAYERS", LAYERS),
                    ("VK_LAYER_PATH", &path),
                    ("VK_KHRONOS_PROFILES_PROFILE_FILE", file.to_str().unwrap()),
                    ("VK_KHRONOS_PROFILES_PROFILE_NAME", name),
                    ("VK_KHRONOS_PROFILES_SIMULATE_CAPABILITIES", simulated),
                    ("VK_KHRONOS_PROFILES_DEFAULT_FEATURE_VALUES", others),
                    ("VK_KHRONOS_PROFILES_DEBUG_REPORTS", "DEBUG_REPORT_NOTIFICATION_BIT"),
                ];
                let (output, found) = drawn(place, line, &variables);
                let what = format!("{name}, {simulated}, {others}, {line}");
                // The layer says what it simulates.
                assert!(text(&output.stdout).contains(name), "{what}: {}", text(&output.stdout));
                if output.status.success() {
                    let said = succeeded(&output);
                    assert!(found == *expected, "{what}: another picture; {said}");
                    same += 1;
                } else {
                    let said = failed(&output, 1);
                    assert!(said.contains(" lacks ") && found.is_none(), "{what}: {said}");
                    refused.push(format!("{name}: {said}"));
                }
            }
        }
    }
    assert_eq!(names(place), given);
    refused.dedup();
    println!("{same} drawn the same; refused: {}", refused.concat());
}
