//! The interface for C, whose calls do what those of Rust do.

use super::*;
use pointillist::c::*;
use std::ffi::{CStr, CString};

/// A renderer of the interface for C.
struct InC(*mut PointillistRenderer);

impl Drop for InC {
    fn drop(&mut self) {
        // SAFETY: it is freed once, after its frames.
        unsafe { pointillist_free(self.0) };
    }
}

/// Runs a call with a place for its message. Errors with the result and the message.
fn called(
    call: impl FnOnce(*mut PointillistError) -> PointillistResult,
) -> Result<(), (PointillistResult, String)> {
    let mut error = PointillistError { message: [0; 1024] };
    match call(&raw mut error) {
        PointillistResult::Ok => Ok(()),
        // SAFETY: messages end with 0.
        result => Err((
            result,
            unsafe { CStr::from_ptr(error.message.as_ptr()) }.to_string_lossy().into_owned(),
        )),
    }
}

fn host_of(application: &Application) -> PointillistHost {
    let host = application.host();
    PointillistHost {
        get_instance_proc_addr: host.get_instance_proc_addr,
        instance: host.instance,
        physical_device: host.physical_device,
        device: host.device,
        queue_family: host.queue_family,
        has_int64_atomics: host.has_int64_atomics as u8,
        has_debug_utils: host.has_debug_utils as u8,
        allocation_callbacks: host.allocation_callbacks,
        ..PointillistHost::default()
    }
}

fn target_of(target: &Target) -> PointillistTarget {
    let access = |access: Access| PointillistAccess {
        layout: access.layout,
        family: access.family,
        stages: access.stages,
        access: access.access,
    };
    PointillistTarget {
        image: target.image,
        view: target.view,
        format: target.format,
        width: target.size[0],
        height: target.size[1],
        samples: target.samples,
        before: access(target.before),
        after: access(target.after),
        clear: target.clear as u8,
        ..PointillistTarget::default()
    }
}

/// A view of a newer header, which has more members.
#[repr(C)]
#[derive(Clone, Copy)]
struct NewerView {
    view: PointillistView,
    more: [u64; 5],
}

impl InC {
    fn new(application: &Application) -> InC {
        let (host, mut made) = (host_of(application), std::ptr::null_mut());
        // SAFETY: the renderer is dropped before the application.
        called(|error| unsafe { pointillist_new(&raw const host, &raw mut made, error) }).unwrap();
        InC(made)
    }

    fn restored(&self, application: &Application) -> InC {
        let (host, mut made) = (host_of(application), std::ptr::null_mut());
        called(|error| unsafe {
            // SAFETY: as above.
            pointillist_restore(self.0, &raw const host, &raw mut made, error)
        })
        .unwrap();
        InC(made)
    }

    fn open(&self, path: &std::path::Path) -> u64 {
        let path = CString::new(path.to_str().unwrap()).unwrap();
        let (files, mut cloud) = ([path.as_ptr()], 0);
        called(|error| unsafe {
            // SAFETY: the names live until the end of the call.
            let color = std::ptr::null();
            pointillist_open(self.0, files.as_ptr(), 1, color, &raw mut cloud, error)
        })
        .unwrap();
        cloud
    }

    fn set(&self, name: &CStr, value: &CStr) {
        // SAFETY: the texts live until the end of the call.
        called(|error| unsafe { pointillist_set(self.0, name.as_ptr(), value.as_ptr(), error) })
            .unwrap();
    }

    fn state(&self, cloud: u64) -> Result<PointillistCloudState, String> {
        let mut state = PointillistCloudState::Failed;
        // SAFETY: there is a place for it.
        called(|error| unsafe { pointillist_state(self.0, cloud, &raw mut state, error) })
            .map_err(|(_, why)| why)?;
        Ok(state)
    }

    fn explained(&self) -> String {
        let mut length = 0;
        // SAFETY: no text is written at first, and then as much as there is room for.
        unsafe {
            let (none, to) = (std::ptr::null_mut(), &raw mut length);
            called(|error| pointillist_explain(self.0, none, 0, to, error)).unwrap();
            let mut text = vec![0u8; length + 1];
            let at = text.as_mut_ptr().cast();
            called(|error| pointillist_explain(self.0, at, text.len(), to, error)).unwrap();
            CStr::from_ptr(at).to_str().unwrap().to_string()
        }
    }

    /// Draws a frame. Returns its report and its colours.
    fn draw(
        &self,
        application: &mut Application,
        views: &[NewerView],
    ) -> Result<(PointillistReport, Vec<u8>), (PointillistResult, String)> {
        let targets = application.targets();
        let (color, depth) = (target_of(&targets.color), target_of(&targets.depth.unwrap()));
        let targets = Targets { ids: None, normals: None, ..targets };
        let drawn = application.submit_recorded(targets, &[], None, |commands, frame| {
            let frame = PointillistFrame {
                number: frame.number,
                safe: frame.safe,
                color: &raw const color,
                depth: &raw const depth,
                writes_depth: 1,
                views: views.as_ptr().cast(),
                view_count: views.len(),
                ..PointillistFrame::default()
            };
            let mut report = PointillistReport::default();
            let handle = commands.as_raw();
            called(|error| unsafe {
                // SAFETY: all of it lives until the frame has been waited for.
                pointillist_record(self.0, handle, &raw const frame, &raw mut report, error)
            })?;
            Ok(report)
        });
        std::mem::replace(&mut application.said, Ok(())).unwrap();
        drawn.map(|(report, color, _)| (report, color))
    }

    fn settle(&self, application: &mut Application, views: &[NewerView]) -> Vec<u8> {
        for _ in 0..2000 {
            let (report, color) = self.draw(application, views).unwrap();
            assert_eq!(report.errors, 0, "{}", self.explained());
            if report.settled {
                return color;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        panic!("the picture never settles");
    }
}

/// Two halves of the targets, for C and for Rust.
fn halves(camera: Camera) -> ([NewerView; 2], [FrameView; 2]) {
    let half = [SIZE[0] / 2, SIZE[1]];
    let of = |side: i32| {
        let mut camera = camera;
        camera.eye += DVec3::splat(0.2 * side as f64);
        let matrices = Matrices::of(&camera, half, 0.01, f64::INFINITY).unwrap();
        let area = Area { corner: [side * half[0] as i32, 0], size: half };
        let view = PointillistView {
            size: size_of::<NewerView>(),
            view: matrices.view,
            projection: matrices.projection,
            x: area.corner[0],
            y: area.corner[1],
            width: half[0],
            height: half[1],
        };
        let own = FrameView { camera: ViewCamera::Matrices(matrices), area };
        (NewerView { view, more: [u64::MAX; 5] }, own)
    };
    let [(left, own_left), (right, own_right)] = [of(0), of(1)];
    ([left, right], [own_left, own_right])
}

#[test]
fn calls_in_c_draw_what_those_in_rust_do() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let place = |i: u32| [(i % 200) as f64 / 100.0 - 1.0, (i / 200) as f64 / 50.0 - 1.0, 0.3];
    let places: Vec<[f64; 3]> = (0..20_000).map(place).collect();
    let colors: Vec<[u8; 3]> = (0..20_000).map(|i| [(i % 250) as u8, 120, 30]).collect();
    let classes: Vec<u8> = (0..20_000).map(|i| (i % 9) as u8).collect();
    let narrow: Vec<[f32; 3]> =
        places.iter().map(|place| [place[0] as f32, 0.2, place[1] as f32]).collect();
    let moved = glam::DMat4::from_translation(DVec3::new(0.4, -0.3, 0.1)).to_cols_array();
    let (newer, views) = halves(camera);

    // In Rust.
    let mut application = Application::new(COLOR);
    let targets = Targets { ids: None, normals: None, ..application.targets() };
    let buffer = application.point_buffer(&narrow);
    let mut renderer = application.renderer();
    renderer.set("effect", "edl=on").unwrap();
    let file = renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
    let points = Points {
        colors: Some(&colors),
        classes: Some(&classes),
        ..Points::new(Positions::F64(&places))
    };
    let points = renderer.add_points(&points).unwrap();
    // SAFETY: the buffer lives as long as the application.
    let of_buffer = unsafe { renderer.add_buffer(buffer) }.unwrap();
    renderer.set_transform(file, &moved).unwrap();
    let mut expected = vec![application.settle(&mut renderer, targets, &views).1];
    renderer.set_visible(file, false).unwrap();
    expected.push(application.settle(&mut renderer, targets, &views).1);
    renderer.set_visible(file, true).unwrap();
    renderer.remove(of_buffer).unwrap();
    expected.push(application.settle(&mut renderer, targets, &views).1);
    renderer.remove(points).unwrap();
    expected.push(application.settle(&mut renderer, targets, &views).1);
    assert!((0..3).all(|i| expected[i] != expected[i + 1]), "each call is seen");
    drop(renderer);

    // In C.
    (application.frame, application.safe) = (0, 0);
    let own = InC::new(&application);
    own.set(c"effect", c"edl=on");
    let file = own.open(&path);
    let given = PointillistPoints {
        count: places.len(),
        positions_f64: places.as_ptr().cast(),
        colors: colors.as_ptr().cast(),
        classes: classes.as_ptr(),
        ..PointillistPoints::default()
    };
    let on_device = PointillistPointBuffer {
        buffer: buffer.buffer,
        offset: buffer.offset,
        stride: buffer.stride,
        count: buffer.count,
        ..PointillistPointBuffer::default()
    };
    let (mut points, mut of_buffer) = (0, 0);
    // SAFETY: the points are copied; the buffer lives as long as the application.
    unsafe {
        let (r, moved) = (own.0, moved.as_ptr());
        called(|e| pointillist_add_points(r, &raw const given, &raw mut points, e)).unwrap();
        called(|e| pointillist_add_buffer(r, &raw const on_device, &raw mut of_buffer, e)).unwrap();
        called(|e| pointillist_set_transform(r, file, moved, e)).unwrap();
        let mut seen = vec![own.settle(&mut application, &newer)];
        called(|e| pointillist_set_visible(r, file, 0, e)).unwrap();
        seen.push(own.settle(&mut application, &newer));
        called(|e| pointillist_set_visible(r, file, 1, e)).unwrap();
        called(|e| pointillist_remove(r, of_buffer, e)).unwrap();
        seen.push(own.settle(&mut application, &newer));
        let told = own.explained();
        for line in ["settled", "ready", "effect edl: on", "pass "] {
            assert!(told.contains(line), "{line}: {told}");
        }
        // A pick of a point of ours has its class.
        let mut picked = PointillistPicked::default();
        called(|e| pointillist_set_visible(r, file, 0, e)).unwrap();
        // Pixels between points have no single one.
        for x in SIZE[0] / 4.. {
            let mut pick = 0;
            called(|e| pointillist_pick(r, x, SIZE[1] / 2, &raw mut pick, e)).unwrap();
            (0..2).for_each(|_| drop(own.draw(&mut application, &newer).unwrap()));
            called(|e| pointillist_picked(r, pick, &raw mut picked, e)).unwrap();
            assert!(picked.answered && picked.met && picked.cloud == points, "{}", picked.cloud);
            if picked.id != u32::MAX {
                break;
            }
        }
        let position = DVec3::from(picked.position);
        // Floats of the host's memory are kept within steps of their range.
        let apart = |i: &usize| DVec3::from(places[*i]).distance(position);
        let i = (0..places.len()).min_by(|i, k| apart(i).total_cmp(&apart(k))).unwrap();
        assert!(apart(&i) < 1e-4, "{position} is none of ours");
        assert_eq!(picked.class_code, classes[i] as i32);
        let planar = (DVec3::from(picked.world) - camera.eye).dot(camera.basis().unwrap().forward);
        assert!((picked.depth - planar).abs() < 1e-4, "{} {planar}", picked.depth);
        let refused = called(|e| pointillist_drop_frame(r, 99_999, e)).unwrap_err();
        assert!(refused.1.contains("cannot be dropped"), "{}", refused.1);
        called(|e| pointillist_set_visible(r, file, 1, e)).unwrap();
        called(|e| pointillist_remove(r, points, e)).unwrap();
        seen.push(own.settle(&mut application, &newer));
        for (number, (seen, expected)) in seen.iter().zip(&expected).enumerate() {
            assert!(seen == expected, "picture {number}");
        }
        let gone = own.state(points).unwrap_err();
        assert!(gone.contains("there is no cloud"), "{gone}");

        // On the next device.
        let mut other = Application::new(COLOR);
        let next = own.restored(&other);
        drop(own);
        assert!(next.settle(&mut other, &newer) == expected[3]);
        assert!(matches!(next.state(file), Ok(PointillistCloudState::Ready)));
    }
}

#[test]
fn a_lost_device_is_told_in_c_and_the_next_one_draws_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let (views, _) = halves(camera);
    let mut application = Application::new(COLOR);
    let own = InC::new(&application);
    let cloud = own.open(&path);
    let before = own.settle(&mut application, &views);
    let mut moved = camera;
    moved.eye += DVec3::splat(0.3);
    let (others, _) = halves(moved);
    drop(own.draw(&mut application, &others).unwrap());
    counting::lose_device(true);
    let (result, why) = own.draw(&mut application, &views).err().expect("the device is lost");
    assert_eq!(result, PointillistResult::DeviceLost, "{why}");
    counting::lose_device(false);
    let mut other = Application::new(COLOR);
    let next = own.restored(&other);
    drop(own);
    assert!(next.settle(&mut other, &views) == before);
    assert!(matches!(next.state(cloud), Ok(PointillistCloudState::Ready)));
}
