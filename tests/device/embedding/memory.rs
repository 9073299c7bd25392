//! Points and device memory of the host.

use super::*;

/// Device memory by functions of the host.
pub(super) mod device_memory {
    use super::*;
    use std::collections::HashMap;
    use std::sync::Mutex;

    /// The functions of the last device, the sizes of what is allocated, and the most bytes of it.
    /// They are another device's after its libraries have been loaded again.
    static REAL: Mutex<Option<(vk::PFN_vkAllocateMemory, vk::PFN_vkFreeMemory)>> = Mutex::new(None);
    pub static HELD: Mutex<Option<HashMap<vk::DeviceMemory, u64>>> = Mutex::new(None);
    pub static MOST: Mutex<u64> = Mutex::new(u64::MAX);
    /// Blocks that are given before all others are refused; None refuses none.
    pub static BLOCKS: Mutex<Option<u64>> = Mutex::new(None);

    fn of(device: &Device) {
        let real = device.raw.fp_v1_0();
        *REAL.lock().unwrap() = Some((real.allocate_memory, real.free_memory));
    }

    fn real() -> (vk::PFN_vkAllocateMemory, vk::PFN_vkFreeMemory) {
        REAL.lock().unwrap().expect("set for every device")
    }

    /// Returns the handles of an application whose device memory is counted here.
    pub fn host_of(application: &Application) -> Host {
        of(&application.device);
        let allocate_memory = allocate as vk::PFN_vkAllocateMemory as *const std::ffi::c_void;
        let free_memory = free as vk::PFN_vkFreeMemory as *const std::ffi::c_void;
        Host { allocate_memory, free_memory, ..application.host() }
    }

    pub fn bytes() -> u64 {
        HELD.lock().unwrap().get_or_insert_default().values().sum()
    }

    pub unsafe extern "system" fn allocate(
        device: vk::Device,
        info: *const vk::MemoryAllocateInfo<'_>,
        callbacks: *const vk::AllocationCallbacks<'_>,
        memory: *mut vk::DeviceMemory,
    ) -> vk::Result {
        // SAFETY: the caller's arguments are passed on.
        unsafe {
            let size = (*info).allocation_size;
            if bytes() + size > *MOST.lock().unwrap() {
                return vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
            }
            match &mut *BLOCKS.lock().unwrap() {
                Some(0) => return vk::Result::ERROR_OUT_OF_DEVICE_MEMORY,
                Some(left) => *left -= 1,
                None => {}
            }
            let result = real().0(device, info, callbacks, memory);
            if result == vk::Result::SUCCESS {
                HELD.lock().unwrap().get_or_insert_default().insert(*memory, size);
            }
            result
        }
    }

    pub unsafe extern "system" fn free(
        device: vk::Device,
        memory: vk::DeviceMemory,
        callbacks: *const vk::AllocationCallbacks<'_>,
    ) {
        HELD.lock().unwrap().get_or_insert_default().remove(&memory).expect("allocated here");
        // SAFETY: the caller's arguments are passed on.
        unsafe { real().1(device, memory, callbacks) }
    }
}

#[test]
fn device_memory_is_the_hosts() {
    let folder = tempfile::tempdir().unwrap();
    let (path, camera) = scan(folder.path());
    let settled = |host_of: fn(&Application) -> Host| {
        let mut application = Application::new(COLOR);
        let host = host_of(&application);
        // SAFETY: the renderer is dropped before the application.
        let mut renderer = unsafe { Renderer::new(&host, RendererOptions::default()) }.unwrap();
        renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
        let targets = application.targets();
        let color = application.settle(&mut renderer, targets, &[view_of(camera)]).1;
        (color, device_memory::bytes())
    };
    let (expected, none) = settled(Application::host);
    let (color, held) = settled(device_memory::host_of);
    assert!(color == expected && none == 0 && held > 0, "{held} bytes");
    assert_eq!(device_memory::bytes(), 0, "all is given back");

    // A host may refuse; both functions are needed.
    *device_memory::MOST.lock().unwrap() = 1 << 20;
    let application = Application::new(COLOR);
    let host = device_memory::host_of(&application);
    // SAFETY: as above.
    let error = match unsafe { Renderer::new(&host, RendererOptions::default()) } {
        Ok(mut renderer) => {
            renderer.open(std::slice::from_ref(&path), &OpenSettings::default()).unwrap();
            application.first_error(&mut renderer, &[view_of(camera)])
        }
        Err(error) => error.to_string(),
    };
    assert!(error.contains("MiB of device memory"), "{error}");
    assert_eq!(device_memory::bytes(), 0, "all is given back");
    let half = Host { free_memory: std::ptr::null(), ..host };
    // SAFETY: as above.
    let error = unsafe { Renderer::new(&half, RendererOptions::default()) }.err().unwrap();
    assert!(error.to_string().contains("free_memory is null"), "{error}");
}

#[test]
fn points_of_memory_are_picked_where_they_are() {
    let mut application = Application::new(COLOR);
    let mut renderer = application.renderer();
    let place = |i: u32| [5e5 + (i % 300) as f64 / 64.0, 4e6 + (i / 300) as f64 / 64.0, 12.5];
    let places: Vec<[f64; 3]> = (0..90_000).map(place).collect();
    let colors: Vec<[u8; 3]> = (0..90_000).map(|i| [(i % 250) as u8, 120, 30]).collect();
    let points = Points { colors: Some(&colors), ..Points::new(Positions::F64(&places)) };
    let cloud = renderer.add_points(&points).unwrap();
    let moved = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 100.0, 0.0, 0.0, 1.0];
    let targets = application.targets();
    let top = |renderer: &Renderer| view_of(renderer.framing(Preset::Fit, SIZE).unwrap());
    let start = view_of(Camera {
        eye: DVec3::new(5e5, 4e6, 30.0),
        target: DVec3::new(5e5, 4e6, 0.0),
        up: DVec3::Y,
        fov_y: 40.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    });
    application.settle(&mut renderer, targets, &[start]);
    let unmoved = top(&renderer);
    let (_, before, _) = application.draw(&mut renderer, targets, &[unmoved], None);
    let pick = renderer.pick([160, 120]);
    let nothing = renderer.pick([0, 0]);
    assert_eq!(renderer.picked(pick), Picked::Pending);
    application.draw(&mut renderer, targets, &[unmoved], None);
    application.draw(&mut renderer, targets, &[unmoved], None);
    let Picked::Point(point) = renderer.picked(pick) else { panic!("a point in the middle") };
    assert!(point.exact && point.cloud == cloud);
    assert!(places.contains(&point.position.to_array()), "{point:?}");
    assert!(point.id.is_some() && point.class == Some(0), "{point:?}");
    let own = places.iter().position(|place| *place == point.position.to_array()).unwrap();
    assert!(point.color == Some(colors[own]) && point.value.is_none(), "{point:?}");
    let (report, ..) = application.draw(&mut renderer, targets, &[unmoved], None);
    let told = renderer.explain(&report);
    for line in ["frame: settled, 90000 points", "cloud 1: ready", "effect fill: ", "pass "] {
        assert!(told.contains(line), "{line}: {told}");
    }
    assert_eq!(renderer.picked(nothing), Picked::Nothing);
    // Moved with the camera, nothing changes on the screen.
    renderer.set_transform(cloud, &moved).unwrap();
    let moved = top(&renderer);
    let (_, after, _) = application.settle(&mut renderer, targets, &[moved]);
    let differing = before.iter().zip(&after).filter(|(a, b)| a != b).count();
    assert!(differing < before.len() / 200, "{differing} bytes");
    renderer.set("style", "strokes").unwrap();
    let (report, ..) = application.draw(&mut renderer, targets, &[moved], None);
    assert!(report.errors[0].contains("drawn as points") && report.points > 0);
    let refused = renderer.set("effect", "edl=perhaps").unwrap_err().to_string();
    assert!(refused.contains("perhaps"), "{refused}");
    renderer.set_visible(cloud, false).unwrap();
    let (_, empty, _) = application.draw(&mut renderer, targets, &[unmoved], None);
    let background = RenderSettings::default().background;
    assert!(empty.chunks(4).all(|pixel| pixel[..3] == background));
    renderer.remove(cloud).unwrap();
    assert!(renderer.state(cloud).is_err());
}

/// Points in a buffer of the device are those of memory.
#[test]
fn points_of_a_buffer_are_drawn_like_those_of_memory() {
    let mut application = Application::new(COLOR);
    let place = |i: u32| [(i % 300) as f32 / 64.0, (i / 300) as f32 / 64.0, (i % 7) as f32 / 8.0];
    let places: Vec<[f32; 3]> = (0..90_000).map(place).collect();
    let colors: Vec<[u8; 3]> = (0..90_000).map(|i| [(i % 250) as u8, 120, 30]).collect();
    let mut bytes = Vec::new();
    for (place, color) in places.iter().zip(&colors) {
        bytes.extend(place.iter().flat_map(|axis| axis.to_le_bytes()));
        bytes.extend(color.iter().chain(&[0; 5]));
    }
    assert!(bytes.len() < POINT_BYTES);
    let offset = 48 * PIXELS;
    // SAFETY: the buffer has room there, and no frame is in flight.
    unsafe {
        let to = application.mapped.add(offset);
        std::ptr::copy_nonoverlapping(bytes.as_ptr(), to, bytes.len());
    }
    let buffer = PointBuffer {
        buffer: application.staging.as_raw(),
        offset: offset as u64,
        stride: 20,
        count: 90_000,
        color_offset: Some(12),
    };
    let targets = application.targets();
    let camera = Camera {
        eye: DVec3::new(2.0, 2.0, 9.0),
        target: DVec3::new(2.0, 2.0, 0.0),
        up: DVec3::Y,
        fov_y: 40.0,
        projection: pointillist::renderer::Projection::Perspective,
        ortho_height: None,
    };
    let mut renderer = application.renderer();
    let points = Points { colors: Some(&colors), ..Points::new(Positions::F32(&places)) };
    let cloud = renderer.add_points(&points).unwrap();
    let (_, of_memory, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    renderer.remove(cloud).unwrap();
    // SAFETY: the buffer lives as long as the application.
    let cloud = unsafe { renderer.add_buffer(buffer) }.unwrap();
    assert!(matches!(renderer.state(cloud).unwrap(), CloudState::Loading { .. }));
    let (report, of_buffer, _) = application.settle(&mut renderer, targets, &[view_of(camera)]);
    assert!(report.points > 0 && of_buffer == of_memory);
    // SAFETY: refused before anything is read.
    let refused = unsafe { renderer.add_buffer(PointBuffer { stride: 8, ..buffer }) };
    assert!(refused.unwrap_err().to_string().contains("stride of at least 15 bytes"));
}

/// Pages go through a ring of mapped memory, whose copies are recorded with the host's frames. The
/// file has more points than the ring holds.
#[test]
fn a_device_whose_memory_is_not_mapped_draws_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.las");
    crate::files::scan(&path, pointillist::synth::SceneKind::Torus, 7_000_000);
    let index = crate::index_file::indexed(&[&path], "");
    let (_, camera) = scan(folder.path());
    for file in [path, index] {
        let pictures = [false, true].map(|unmapped| {
            let mut application = Application::new(COLOR);
            let overrides = TestOverrides { unmapped, ..TestOverrides::default() };
            let options = RendererOptions { overrides, ..RendererOptions::default() };
            // SAFETY: the renderer is dropped before the application.
            let mut renderer = unsafe { Renderer::new(&application.host(), options) }.unwrap();
            renderer.open(std::slice::from_ref(&file), &OpenSettings::default()).unwrap();
            let targets = application.targets();
            application.settle(&mut renderer, targets, &[view_of(camera)]).1
        });
        assert!(pictures[0] == pictures[1], "{}", file.display());
    }
}

/// An index that is added takes its share of the memory of the one before. The other has all of it
/// again when the first is removed. Memory is that of the host, and so counted.
#[test]
fn indexes_share_the_memory_of_nodes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.las");
    crate::files::scan(&path, pointillist::synth::SceneKind::Torus, 7_000_000);
    let index = crate::index_file::indexed(&[&path], "");
    let (_, camera) = scan(folder.path());
    let mut application = Application::new(COLOR);
    let host = device_memory::host_of(&application);
    const BLOCK: u64 = 64 << 20;
    let blocks = || {
        let held = device_memory::HELD.lock().unwrap();
        held.iter().flat_map(|held| held.values()).filter(|&&bytes| bytes >= BLOCK).count()
    };
    let options = RendererOptions { memory_budget: 3 * BLOCK, ..RendererOptions::default() };
    // SAFETY: the renderer is dropped before the application.
    let mut renderer = unsafe { Renderer::new(&host, options) }.unwrap();
    // All points are called for.
    renderer.set("lod", "0").unwrap();
    renderer.set("budget", "100000000").unwrap();
    let settings = OpenSettings::default();
    let first = renderer.open(std::slice::from_ref(&index), &settings).unwrap();
    let targets = application.targets();
    let views = [view_of(camera)];
    let (report, alone, _) = application.settle(&mut renderer, targets, &views);
    let all = blocks();
    assert!(report.points == 7_000_000 && all >= 3, "{} points, {all} blocks", report.points);
    let second = renderer.open(std::slice::from_ref(&index), &settings).unwrap();
    let (report, ..) = application.settle(&mut renderer, targets, &views);
    println!("{} points of two", report.points);
    assert!(report.points < 14_000_000 && report.errors.is_empty(), "{report:?}");
    // Pages that are given back are freed once no frame may read them.
    for _ in 0..3 {
        application.draw(&mut renderer, targets, &views, None);
    }
    // A block each.
    assert_eq!(blocks(), all - 1);
    renderer.remove(first).unwrap();
    let (report, color, _) = application.settle(&mut renderer, targets, &views);
    assert!(report.points == 7_000_000 && color == alone);
    for _ in 0..3 {
        application.draw(&mut renderer, targets, &views, None);
    }
    assert_eq!(blocks(), all);
    renderer.remove(second).unwrap();
    for _ in 0..3 {
        application.draw(&mut renderer, targets, &views, None);
    }
    assert_eq!(blocks(), all - 3);
}
