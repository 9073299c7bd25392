//! Programs of others that read what this one has written, or the system as it does: laspy, GDAL,
//! ffprobe, Tesseract and vulkaninfo.

use crate::program::text;
use crate::skip::skip;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Runs a script in Python with laspy. Returns what it prints; `None` if there is no laspy.
pub fn laspy(script: &str, files: &[&Path]) -> Option<String> {
    let python = |script: &str, files: &[&Path]| {
        Command::new("python3").arg("-c").arg(script).args(files).output()
    };
    let has_it = "import laspy; assert laspy.LazBackend.detect_available()";
    if !python(has_it, &[]).is_ok_and(|output| output.status.success()) {
        skip("python3 with laspy and lazrs is missing");
        return None;
    }
    let output = python(script, files).unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    Some(text(&output.stdout).trim().to_string())
}

/// Runs a program of GDAL. Returns what it prints; `None` if it is missing.
pub fn gdal(program: &str, line: &str, files: &[&Path]) -> Option<String> {
    match Command::new(program).args(line.split_whitespace()).args(files).output() {
        Err(_) => {
            skip(&format!("{program} is missing; Debian has it in gdal-bin"));
            None
        }
        Ok(output) => {
            let said = text(&output.stderr);
            assert!(output.status.success() && said.is_empty(), "{program} {line}: {said}");
            Some(text(&output.stdout))
        }
    }
}

pub fn gdalinfo(path: &Path) -> Option<Value> {
    gdal("gdalinfo", "-json", &[path]).map(|text| serde_json::from_str(&text).unwrap())
}

/// Returns the mean over all pixels and channels of a picture; `None` if GDAL is missing.
pub fn mean(picture: &Path) -> Option<f64> {
    let info = gdal("gdalinfo", "--config GDAL_PAM_ENABLED NO -json -stats", &[picture])?;
    let info: Value = serde_json::from_str(&info).unwrap();
    let bands = info["bands"].as_array().unwrap();
    let means = bands.iter().map(|band| band["mean"].as_f64().unwrap());
    Some(means.sum::<f64>() / bands.len() as f64)
}

/// Returns the words that Tesseract reads in a picture; `None` if it is missing.
pub fn words(picture: &Path) -> Option<Vec<String>> {
    let Ok(output) = Command::new("tesseract").arg(picture).args(["-", "--psm", "11"]).output()
    else {
        skip("tesseract is missing; Debian has it in tesseract-ocr");
        return None;
    };
    assert!(output.status.success(), "{}", text(&output.stderr));
    Some(text(&output.stdout).split_whitespace().map(str::to_string).collect())
}

/// Tests whether vulkaninfo finds a device with these drivers; `None` if it is missing.
pub fn has_vulkan_device(drivers: &str) -> Option<bool> {
    let mut command = Command::new("vulkaninfo");
    command.arg("--summary").env("VK_DRIVER_FILES", drivers).env("VK_ICD_FILENAMES", drivers);
    let Ok(output) = command.output() else {
        skip("vulkaninfo is missing; Debian has it in vulkan-tools");
        return None;
    };
    Some(output.status.success() && text(&output.stdout).contains("deviceName"))
}

/// Returns width, height, frames a second and the number of frames of a film, by commas; `None` if
/// there is no ffprobe.
pub fn ffprobe(film: &Path) -> Option<String> {
    let probe = Command::new("ffprobe")
        .args(["-v", "error", "-count_frames", "-select_streams", "v:0", "-of", "csv=p=0"])
        .args(["-show_entries", "stream=width,height,r_frame_rate,nb_read_frames"])
        .arg(film)
        .output();
    match probe {
        Err(_) => {
            skip("there is no ffprobe");
            None
        }
        Ok(output) => Some(text(&output.stdout).trim().to_string()),
    }
}
