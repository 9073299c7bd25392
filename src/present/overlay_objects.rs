//! The Vulkan objects that the crate of the panel makes.
//!
//! If it fails halfway, it forgets them. So it is given functions that list what they make, and
//! what is left on the list is destroyed.

use ash::vk::{self, Handle};
use std::sync::{Mutex, PoisonError};

/// The functions of a device, and what was made with them and is not destroyed, in order.
struct Made {
    device: ash::Device,
    objects: Vec<(vk::ObjectType, u64)>,
}

/// One for each [`OverlayObjects`]: Vulkan's functions have no other place for what is theirs.
static MADE: Mutex<Vec<Made>> = Mutex::new(Vec::new());

fn with_all<T>(act: impl FnOnce(&mut Vec<Made>) -> T) -> T {
    act(&mut MADE.lock().unwrap_or_else(PoisonError::into_inner))
}

fn with<T>(device: vk::Device, act: impl FnOnce(&mut Made) -> T) -> T {
    with_all(|all| {
        let own = all.iter_mut().find(|own| own.device.handle() == device);
        act(own.expect("functions are used as long as their list"))
    })
}

fn list<T: Handle>(device: vk::Device, object: T) {
    with(device, |own| own.objects.push((T::TYPE, object.as_raw())));
}

/// Removes an object from the list. Returns whether it was there.
fn unlist<T: Handle>(device: vk::Device, object: T) -> bool {
    let object = (T::TYPE, object.as_raw());
    with(device, |own| {
        let at = own.objects.iter().rposition(|&other| other == object);
        at.map(|at| own.objects.remove(at)).is_some()
    })
}

type Callbacks<'c> = *const vk::AllocationCallbacks<'c>;

macro_rules! listed {
    ($($create:ident $info:ident $destroy:ident $object:ident;)*) => {
        $(
            unsafe extern "system" fn $create(
                device: vk::Device,
                info: *const vk::$info<'_>,
                callbacks: Callbacks<'_>,
                made: *mut vk::$object,
            ) -> vk::Result {
                let create = with(device, |own| own.device.fp_v1_0().$create);
                // SAFETY: as the caller ensures; a call that succeeds writes the object.
                unsafe {
                    let result = create(device, info, callbacks, made);
                    if result == vk::Result::SUCCESS {
                        list(device, *made);
                    }
                    result
                }
            }

            unsafe extern "system" fn $destroy(
                device: vk::Device,
                object: vk::$object,
                callbacks: Callbacks<'_>,
            ) {
                if unlist(device, object) {
                    let destroy = with(device, |own| own.device.fp_v1_0().$destroy);
                    // SAFETY: as the caller ensures.
                    unsafe { destroy(device, object, callbacks) };
                }
            }
        )*

        fn list_all(functions: &mut ash::DeviceFnV1_0) {
            $(
                functions.$create = $create;
                functions.$destroy = $destroy;
            )*
        }

        /// Destroys an object of a list.
        ///
        /// # Safety
        /// Nothing uses it, and nothing will.
        unsafe fn destroy(device: &ash::Device, (kind, raw): (vk::ObjectType, u64)) {
            // SAFETY: as the caller ensures.
            unsafe {
                match kind {
                    $(
                        <vk::$object as Handle>::TYPE => {
                            device.$destroy(vk::$object::from_raw(raw), None);
                        }
                    )*
                    _ => device.destroy_pipeline(vk::Pipeline::from_raw(raw), None),
                }
            }
        }
    };
}

listed! {
    allocate_memory MemoryAllocateInfo free_memory DeviceMemory;
    create_buffer BufferCreateInfo destroy_buffer Buffer;
    create_descriptor_pool DescriptorPoolCreateInfo destroy_descriptor_pool DescriptorPool;
    create_descriptor_set_layout DescriptorSetLayoutCreateInfo destroy_descriptor_set_layout
        DescriptorSetLayout;
    create_image ImageCreateInfo destroy_image Image;
    create_image_view ImageViewCreateInfo destroy_image_view ImageView;
    create_pipeline_layout PipelineLayoutCreateInfo destroy_pipeline_layout PipelineLayout;
    create_sampler SamplerCreateInfo destroy_sampler Sampler;
    create_shader_module ShaderModuleCreateInfo destroy_shader_module ShaderModule;
}

unsafe extern "system" fn create_graphics_pipelines(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::GraphicsPipelineCreateInfo<'_>,
    callbacks: Callbacks<'_>,
    made: *mut vk::Pipeline,
) -> vk::Result {
    let create = with(device, |own| own.device.fp_v1_0().create_graphics_pipelines);
    // SAFETY: as the caller ensures. A call that fails may write nothing, so pipelines are null.
    unsafe {
        std::ptr::write_bytes(made, 0, count as usize);
        let result = create(device, cache, count, infos, callbacks, made);
        let made = std::slice::from_raw_parts(made, count as usize);
        made.iter().filter(|own| !own.is_null()).for_each(|&own| list(device, own));
        result
    }
}

unsafe extern "system" fn destroy_pipeline(
    device: vk::Device,
    pipeline: vk::Pipeline,
    callbacks: Callbacks<'_>,
) {
    if unlist(device, pipeline) {
        let destroy = with(device, |own| own.device.fp_v1_0().destroy_pipeline);
        // SAFETY: as the caller ensures.
        unsafe { destroy(device, pipeline, callbacks) };
    }
}

/// The objects of a device that are on its list. They are destroyed with this.
pub struct OverlayObjects(vk::Device);

impl OverlayObjects {
    /// Begins the list of a device, which may have one at a time. Also returns its functions that
    /// list what they make, and destroy only that.
    ///
    /// # Safety
    /// The functions are used as long as this lives. Nothing is in flight when it is dropped.
    pub unsafe fn begin(device: &ash::Device) -> (OverlayObjects, ash::Device) {
        with_all(|all| {
            let is_free = all.iter().all(|own| own.device.handle() != device.handle());
            assert!(is_free, "a device has one panel");
            all.push(Made { device: device.clone(), objects: Vec::new() });
        });
        let mut functions = device.fp_v1_0().clone();
        list_all(&mut functions);
        functions.create_graphics_pipelines = create_graphics_pipelines;
        functions.destroy_pipeline = destroy_pipeline;
        let listing = ash::Device::from_parts_1_3(
            device.handle(),
            functions,
            device.fp_v1_1().clone(),
            device.fp_v1_2().clone(),
            device.fp_v1_3().clone(),
        );
        (OverlayObjects(device.handle()), listing)
    }
}

impl Drop for OverlayObjects {
    fn drop(&mut self) {
        let own = with_all(|all| {
            let at = all.iter().position(|own| own.device.handle() == self.0);
            all.remove(at.expect("it was begun"))
        });
        for object in own.objects.into_iter().rev() {
            // SAFETY: as the caller of `begin` ensures.
            unsafe { destroy(&own.device, object) };
        }
    }
}
