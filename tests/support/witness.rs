//! Programs of others that read what this one has written: laspy, GDAL and ffprobe.

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
