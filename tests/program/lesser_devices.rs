//! A device that has less than others draws the same bytes, or is refused with the name of what it
//! lacks, without a word of the validation layers.
//!
//! A layer below validation (`tests/support/faulty_layer.c`) hides features and lowers limits.

#![cfg(target_os = "linux")]

use crate::faulty_layer::{self, Layer};
use crate::files::{names, scan};
use crate::program::{failed, pointillist, succeeded};
use pointillist::renderer::requirements;
use pointillist::synth::SceneKind;
use std::path::Path;
use std::process::Output;

/// Least limits that Vulkan 1.3 allows, and largest alignments, of all that rendering uses, but for
/// [`NEEDED`].
const LEAST: &[(&str, u32)] = &[
    ("bufferImageGranularity", 131_072),
    ("maxBoundDescriptorSets", 4),
    ("maxBufferSize", 1 << 30),
    ("maxColorAttachments", 4),
    ("maxComputeSharedMemorySize", 16_384),
    ("maxComputeWorkGroupCount", 65_535),
    ("maxComputeWorkGroupDepth", 64),
    ("maxComputeWorkGroupInvocations", 128),
    ("maxComputeWorkGroupSize", 128),
    ("maxDescriptorSetStorageBuffers", 24),
    ("maxDescriptorSetStorageImages", 24),
    ("maxFragmentCombinedOutputResources", 4),
    ("maxFragmentInputComponents", 64),
    ("maxFragmentOutputAttachments", 4),
    ("maxFramebufferHeight", 4096),
    ("maxFramebufferWidth", 4096),
    ("maxImageDimension2D", 4096),
    ("maxMemoryAllocationCount", 4096),
    ("maxMemoryAllocationSize", 1 << 30),
    ("maxPerSetDescriptors", 1024),
    ("maxPerStageResources", 128),
    ("maxPushConstantsSize", 128),
    ("maxStorageBufferRange", 1 << 27),
    ("maxTexelBufferElements", 65_536),
    ("maxVertexInputAttributes", 16),
    ("maxVertexInputBindings", 16),
    ("maxVertexOutputComponents", 64),
    ("maxViewportDimensions", 4096),
    ("minMemoryMapAlignment", 64),
    ("minStorageBufferOffsetAlignment", 256),
    ("minTexelBufferOffsetAlignment", 256),
    ("nonCoherentAtomSize", 256),
    ("timestampComputeAndGraphics", 0),
    ("timestampValidBits", 0),
];

/// Limits that must be above the least that Vulkan allows.
const NEEDED: [&str; 2] =
    ["maxPerStageDescriptorStorageBuffers", "maxPerStageDescriptorStorageImages"];

/// Draws with the words of `line` under validation, and with these variables of the environment.
/// Returns how the program ended, and the picture that it left.
pub fn drawn(folder: &Path, line: &str, variables: &[(&str, &str)]) -> (Output, Option<Vec<u8>>) {
    let mut command = pointillist();
    command.arg("render").args(line.split_whitespace()).args(["-o", "a.png", "--validate"]);
    command.args(["--size", "64x48"]).current_dir(folder).envs(variables.iter().copied());
    let output = command.output().unwrap();
    let picture = folder.join("a.png");
    let bytes = std::fs::read(&picture).ok();
    let _ = std::fs::remove_file(picture);
    (output, bytes)
}

/// Draws with the layer that takes features away.
fn render(folder: &Path, line: &str, variables: &[(&str, &str)]) -> (Output, Option<Vec<u8>>) {
    let layer = faulty_layer::environment(folder, Layer::BelowValidation);
    let layer = layer.iter().map(|(name, value)| (*name, value.as_str()));
    drawn(folder, line, &variables.iter().copied().chain(layer).collect::<Vec<_>>())
}

#[test]
fn a_device_that_has_less_draws_the_same_or_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    if !faulty_layer::build(place) {
        return;
    }
    scan(&place.join("a.las"), SceneKind::Street, 20_000);
    let mut index = pointillist();
    index.args(["index", "a.las", "-o", "a.pnti", "--normals", "--strokes"]).current_dir(place);
    succeeded(&index.output().unwrap());
    let given = names(place);

    let limits: Vec<String> = LEAST.iter().map(|(name, value)| format!("{name}={value}")).collect();
    let limits = limits.join(",");
    let optional: Vec<_> = requirements().into_iter().filter(|asked| !asked.required).collect();
    let mut drawn = 0;
    for line in [
        "a.las",
        "a.las --style points",
        "a.las --effect shadows=on --opacity class:2=0.5",
        "a.pnti --unmapped",
        "a.pnti --style strokes",
        "a.pnti --style strokes --effect strokes=blend=opaque",
    ] {
        let (output, expected) = render(place, line, &[]);
        succeeded(&output);
        let all = optional.iter().map(|asked| asked.feature).collect::<Vec<_>>().join(",");
        let each = optional.iter().take(usize::from(drawn == 0) * optional.len());
        let mut lesser =
            vec![vec![("LIMITS", &*limits)], vec![("LIMITS", &limits), ("HIDDEN", &all)]];
        lesser.extend(each.map(|asked| vec![("HIDDEN", asked.feature)]));
        for variables in lesser {
            let (output, found) = render(place, line, &variables);
            let said = succeeded(&output);
            assert!(found == expected, "{line}, {variables:?}: another picture; {said}");
            drawn += 1;
        }
    }

    let mut refused = 0;
    let mut is_refused = |variable: &str, value: &str, name: &str| {
        let (output, found) = render(place, "a.las", &[(variable, value)]);
        let said = failed(&output, 1);
        assert!(said.contains("lacks ") && said.contains(name) && found.is_none(), "{said}");
        refused += 1;
    };
    for asked in requirements().iter().filter(|asked| asked.required) {
        is_refused("HIDDEN", asked.feature, asked.feature);
    }
    for name in NEEDED {
        is_refused("LIMITS", &format!("{name}=4"), name);
    }
    // Vulkan 1.2.
    is_refused("LIMITS", "apiVersion=4202496", "Vulkan 1.3");
    assert_eq!(names(place), given);
    println!("{drawn} drawn the same, {refused} refused");
}
