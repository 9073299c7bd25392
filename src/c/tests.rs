//! Calls that no host should make, and structs of older and newer hosts.

use super::structs::TARGET;
use super::*;
use crate::gpu::DeviceOptions;
use crate::renderer::Preset;
use std::ffi::CStr;

/// Runs a call that must be refused. Returns its message.
fn refused(call: impl FnOnce(*mut PointillistError) -> PointillistResult) -> String {
    let mut error = PointillistError { message: [0; 1024] };
    assert_eq!(call(&raw mut error), PointillistResult::Request);
    // SAFETY: messages end with 0.
    unsafe { CStr::from_ptr(error.message.as_ptr()) }.to_str().unwrap().into()
}

/// Every function refuses every null that it may not have, and its outputs stay.
#[test]
fn null_is_refused_by_every_function() {
    let none = std::ptr::null_mut::<PointillistRenderer>();
    let (mut cloud, mut pick) = (7, 7);
    let (name, value) = (c"style".as_ptr(), c"points".as_ptr());
    let file = [c"scan.laz".as_ptr()];
    let points = PointillistPoints::default();
    let (buffer, unit) = (PointillistPointBuffer::default(), [0.0; 16]);
    let (mut view, frame) = (PointillistView::default(), PointillistFrame::default());
    let mut state = PointillistCloudState::Failed;
    let mut picked = PointillistPicked::default();
    let (host, mut made) = (PointillistHost::default(), none);
    let null = std::ptr::null::<u8>();
    let (to_cloud, to_pick, to_made) = (&raw mut cloud, &raw mut pick, &raw mut made);
    let (to_view, to_state, to_picked) = (&raw mut view, &raw mut state, &raw mut picked);
    type Error = *mut PointillistError;
    // SAFETY: null is refused before anything is read.
    unsafe {
        let all: [&mut dyn FnMut(Error) -> PointillistResult; 20] = [
            &mut |e| pointillist_check(null.cast(), 0, 0, e),
            &mut |e| pointillist_new(null.cast(), to_made, e),
            &mut |e| pointillist_new(&raw const host, null.cast_mut().cast(), e),
            &mut |e| pointillist_new(&raw const host, to_made, e),
            &mut |e| pointillist_restore(none, &raw const host, to_made, e),
            &mut |e| pointillist_restore(none, &raw const host, null.cast_mut().cast(), e),
            &mut |e| pointillist_open(none, file.as_ptr(), 1, null.cast(), to_cloud, e),
            &mut |e| pointillist_add_points(none, &raw const points, to_pick, e),
            &mut |e| pointillist_add_buffer(none, &raw const buffer, to_pick, e),
            &mut |e| pointillist_remove(none, 1, e),
            &mut |e| pointillist_set_visible(none, 1, 1, e),
            &mut |e| pointillist_set_transform(none, 1, unit.as_ptr(), e),
            &mut |e| pointillist_state(none, 1, to_state, e),
            &mut |e| pointillist_set(none, name, value, e),
            &mut |e| pointillist_frame_clouds(none, 4, 0.1, 1.0, to_view, e),
            &mut |e| pointillist_record(none, 1, &raw const frame, null.cast_mut().cast(), e),
            &mut |e| pointillist_pick(none, 1, 1, to_pick, e),
            &mut |e| pointillist_picked(none, 1, to_picked, e),
            &mut |e| pointillist_enable_features(null.cast_mut().cast(), 0, e),
            &mut |e| {
                pointillist_explain(none, null.cast_mut().cast(), 0, null.cast_mut().cast(), e)
            },
        ];
        for (number, call) in all.into_iter().enumerate() {
            let mut call = |e| call(e);
            let said = refused(&mut call);
            assert!(said.contains("null") || said.contains("chain has no"), "{number}: {said}");
            // Without a place for the message, too.
            assert_eq!(call(std::ptr::null_mut()), PointillistResult::Request);
        }
        pointillist_free(none);
    }
    assert_eq!((cloud, pick, state), (7, 7, PointillistCloudState::Failed));
    assert!(!picked.answered && made.is_null());
}

/// Structs of newer and of broken callers.
#[test]
fn sizes_are_read_as_far_as_they_go() {
    let of_size =
        |size: usize| PointillistPoints { size, count: 5, ..PointillistPoints::default() };
    let read = |size: usize| {
        let points = of_size(size);
        // SAFETY: no more than the struct is read.
        unsafe { sized(&raw const points, PointillistPoints::default(), "points") }
    };
    for size in [0, 1, size_of::<usize>() - 1, (1 << 16) + 1, usize::MAX] {
        let refused = read(size).err().expect("a wrong size").to_string();
        assert!(refused.contains("_default"), "{refused}");
    }
    // A caller that knows the size alone, and one that knows more than we do.
    assert_eq!(read(size_of::<usize>()).unwrap().count, 0);
    assert_eq!(read(size_of::<PointillistPoints>() + 64).unwrap().count, 5);
}

/// A caller of an older header, and one of a newer.
#[test]
fn defaults_are_as_large_as_the_caller_says() {
    const LARGEST: usize = size_of::<PointillistView>() + 32;
    for size in [0, 4, size_of::<usize>(), 40, size_of::<PointillistView>(), LARGEST] {
        let mut memory = [0xAAu8; LARGEST + 8];
        // SAFETY: the memory has more bytes than that.
        unsafe { pointillist_view_init(memory.as_mut_ptr().cast(), size) };
        let written = if size < size_of::<usize>() { 0 } else { size };
        assert!(memory[written..].iter().all(|byte| *byte == 0xAA), "{size}");
        if written > 0 {
            assert_eq!(memory[..size_of::<usize>()], size.to_ne_bytes());
        }
        if size == LARGEST {
            assert!(memory[size_of::<PointillistView>()..LARGEST].iter().all(|byte| *byte == 0));
        }
    }
    // SAFETY: null is left alone.
    unsafe { pointillist_view_init(std::ptr::null_mut(), LARGEST) };
}

/// Returns the text of an array of characters.
fn text(characters: &[c_char]) -> String {
    // SAFETY: every text ends with 0.
    unsafe { CStr::from_ptr(characters.as_ptr()) }.to_str().unwrap().into()
}

#[test]
fn requirements_are_those_of_the_library() {
    let all = requirements();
    assert_eq!(pointillist_requirement_count() as usize, all.len());
    for (number, own) in all.iter().enumerate() {
        let mut found = PointillistRequirement::default();
        let error = std::ptr::null_mut();
        // SAFETY: it is a struct of its size.
        let result = unsafe { pointillist_requirement(number as u32, &raw mut found, error) };
        assert_eq!(result, PointillistResult::Ok);
        let texts = [&found.structure[..], &found.feature, &found.purpose].map(text);
        assert_eq!(texts, [own.structure, own.feature, own.purpose]);
        assert_eq!(found.required, own.required);
    }
    let mut found = PointillistRequirement::default();
    // SAFETY: as above.
    let said = refused(|error| unsafe { pointillist_requirement(999, &raw mut found, error) });
    assert!(said.contains("no requirement 999") && text(&found.feature).is_empty(), "{said}");
}

/// Returns a renderer with a device of its own, to be freed.
fn opened() -> *mut PointillistRenderer {
    let (device, options) = (DeviceOptions::default(), RendererOptions::default());
    boxed(Renderer::open_device(&device, options).unwrap())
}

/// A panic may leave a renderer halfway.
#[test]
fn a_renderer_can_only_be_freed_after_a_panic() {
    let (own, mut pick) = (opened(), 7);
    // SAFETY: the renderer is alive until it is freed.
    unsafe {
        let mut error = PointillistError { message: [0; 1024] };
        assert_eq!(
            pointillist_pick(own, 1, 1, &raw mut pick, &raw mut error),
            PointillistResult::Ok
        );
        let asked = pick;
        let result = guarded(&raw mut error, || {
            let _own = renderer(own)?;
            panic!("of this test")
        });
        assert_eq!(result, PointillistResult::Panic);
        let result = pointillist_pick(own, 2, 2, &raw mut pick, &raw mut error);
        assert_eq!((result, pick), (PointillistResult::Panic, asked));
        let said = text(&error.message);
        assert!(said.contains("fault of pointillist"), "{said}");
        pointillist_free(own);
    }
}

/// A call is refused while another one has the renderer, and is answered afterwards.
#[test]
fn calls_from_two_threads_do_not_meet() {
    let (own, mut pick) = (opened(), 7);
    // SAFETY: the renderer is alive until it is freed.
    unsafe {
        let first = renderer(own).unwrap();
        let address = own as usize;
        let said = std::thread::spawn(move || {
            let (own, mut pick) = (address as *mut PointillistRenderer, 7);
            let said = refused(|error| pointillist_pick(own, 1, 1, &raw mut pick, error));
            assert_eq!(pick, 7);
            said
        });
        assert!(said.join().unwrap().contains("in another call"));
        drop(first);
        let null = std::ptr::null_mut();
        assert_eq!(pointillist_pick(own, 1, 1, &raw mut pick, null), PointillistResult::Ok);
        // An answer without a place, or with a place of no size, stays for the next call.
        let said = refused(|error| pointillist_picked(own, pick, null.cast(), error));
        assert_eq!(said, "picked is null");
        let mut picked = PointillistPicked { size: 3, ..PointillistPicked::default() };
        let said = refused(|error| pointillist_picked(own, pick, &raw mut picked, error));
        assert!(said.contains("picked has the size 3") && !picked.answered, "{said}");
        pointillist_free(own);
    }
}

#[test]
fn numbers_that_are_no_choice_are_refused() {
    assert_eq!(preset(PointillistPreset::Iso as i32).unwrap(), Preset::Iso);
    for number in [-1, 5, i32::MAX] {
        let said = preset(number).unwrap_err().to_string();
        assert!(said.contains(&format!("no preset {number}")), "{said}");
    }
    let null = std::ptr::null_mut();
    // SAFETY: refused before anything is read.
    let said = refused(|error| unsafe { pointillist_enable_features(null, 2, error) });
    assert_eq!(said, "optional is 2; give 0 or 1");
    let host = PointillistHost { has_debug_utils: 255, ..PointillistHost::default() };
    let mut made = std::ptr::null_mut();
    // SAFETY: as above.
    let said = refused(|error| unsafe { pointillist_new(&raw const host, &raw mut made, error) });
    assert_eq!(said, "has_debug_utils is 255; give 0 or 1");
    assert!(made.is_null());
    let wrong = PointillistTarget { clear: 7, ..TARGET };
    assert!(target(&wrong).unwrap_err().to_string().contains("clear is 7"));
    // SAFETY: refused before anything is read.
    let endless = unsafe { array([0.0f64].as_ptr(), usize::MAX) }.unwrap_err();
    assert!(endless.to_string().contains("memory ends before"), "{endless}");
}
