//! A Vulkan device's functions, with the allocation callbacks of the application that made it, and
//! the only place where objects are made and destroyed.

use super::failed;
use crate::error::Result;
use ash::prelude::VkResult;
use ash::vk;
use std::ops::Deref;

/// The functions of a device, and the host's callbacks for the CPU memory of its objects. Device
/// memory is allocated without them.
#[derive(Clone)]
pub struct LogicalDevice {
    functions: ash::Device,
    callbacks: Option<vk::AllocationCallbacks<'static>>,
}

// SAFETY: Vulkan calls callbacks on the thread of the call, which hosts are told to allow.
unsafe impl Send for LogicalDevice {}
// SAFETY: as above.
unsafe impl Sync for LogicalDevice {}

impl LogicalDevice {
    pub fn new(
        functions: ash::Device,
        callbacks: Option<vk::AllocationCallbacks<'static>>,
    ) -> LogicalDevice {
        LogicalDevice { functions, callbacks }
    }

    /// Makes an object.
    ///
    /// # Safety
    /// The description is valid for this device.
    pub unsafe fn make<I: Description>(&self, info: &I) -> Result<Fresh<'_, I::Object>> {
        // SAFETY: as the caller ensures.
        let made = unsafe { info.make(&self.functions, self.callbacks.as_ref()) };
        Ok(Fresh { object: made.map_err(failed(I::CALL))?, device: self })
    }

    /// Destroys an object; null is none.
    ///
    /// # Safety
    /// The object was made here, nothing uses it, and nothing will.
    pub unsafe fn destroy(&self, object: impl Object) {
        // SAFETY: as the caller ensures.
        unsafe { object.destroy(&self.functions, self.callbacks.as_ref()) };
    }
}

impl Deref for LogicalDevice {
    type Target = ash::Device;

    fn deref(&self) -> &ash::Device {
        &self.functions
    }
}

/// An object that nothing uses yet. It is destroyed unless it is kept, because what it is made for
/// may fail.
pub struct Fresh<'d, T: Object> {
    object: T,
    device: &'d LogicalDevice,
}

impl<T: Object> Fresh<'_, T> {
    /// Returns the object, which the caller destroys from now on.
    pub fn keep(self) -> T {
        std::mem::ManuallyDrop::new(self).object
    }
}

impl<T: Object> Deref for Fresh<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.object
    }
}

impl<T: Object> Drop for Fresh<'_, T> {
    fn drop(&mut self) {
        // SAFETY: it was not kept.
        unsafe { self.device.destroy(self.object) };
    }
}

type Callbacks<'c> = Option<&'c vk::AllocationCallbacks<'static>>;

/// An object that [`LogicalDevice::destroy`] destroys.
pub trait Object: Copy {
    /// Destroys it.
    ///
    /// # Safety
    /// The object was made by this device, nothing uses it, and nothing will.
    unsafe fn destroy(self, device: &ash::Device, callbacks: Callbacks);
}

/// Description of an object for [`LogicalDevice::make`].
pub trait Description {
    type Object: Object;
    /// Name of the call that makes it, for errors.
    const CALL: &'static str;

    /// Makes the object.
    ///
    /// # Safety
    /// The description is valid for this device.
    unsafe fn make(&self, device: &ash::Device, callbacks: Callbacks) -> VkResult<Self::Object>;
}

macro_rules! objects {
    ($($object:ident $destroy:ident;)*) => {$(
        impl Object for vk::$object {
            unsafe fn destroy(self, device: &ash::Device, callbacks: Callbacks) {
                // SAFETY: as the caller ensures.
                unsafe { device.$destroy(self, callbacks) };
            }
        }
    )*};
}

objects! {
    Buffer destroy_buffer;
    BufferView destroy_buffer_view;
    CommandPool destroy_command_pool;
    DescriptorPool destroy_descriptor_pool;
    DescriptorSetLayout destroy_descriptor_set_layout;
    Fence destroy_fence;
    Image destroy_image;
    ImageView destroy_image_view;
    Pipeline destroy_pipeline;
    PipelineLayout destroy_pipeline_layout;
    QueryPool destroy_query_pool;
    Semaphore destroy_semaphore;
    ShaderModule destroy_shader_module;
}

macro_rules! descriptions {
    ($($info:ident $object:ident $create:ident $call:literal;)*) => {$(
        impl Description for vk::$info<'_> {
            type Object = vk::$object;
            const CALL: &'static str = $call;

            unsafe fn make(
                &self,
                device: &ash::Device,
                callbacks: Callbacks,
            ) -> VkResult<vk::$object> {
                // SAFETY: as the caller ensures.
                unsafe { device.$create(self, callbacks) }
            }
        }
    )*};
}

descriptions! {
    BufferCreateInfo Buffer create_buffer "vkCreateBuffer";
    BufferViewCreateInfo BufferView create_buffer_view "vkCreateBufferView";
    CommandPoolCreateInfo CommandPool create_command_pool "vkCreateCommandPool";
    DescriptorPoolCreateInfo DescriptorPool create_descriptor_pool "vkCreateDescriptorPool";
    DescriptorSetLayoutCreateInfo DescriptorSetLayout create_descriptor_set_layout
        "vkCreateDescriptorSetLayout";
    FenceCreateInfo Fence create_fence "vkCreateFence";
    ImageCreateInfo Image create_image "vkCreateImage";
    ImageViewCreateInfo ImageView create_image_view "vkCreateImageView";
    PipelineLayoutCreateInfo PipelineLayout create_pipeline_layout "vkCreatePipelineLayout";
    QueryPoolCreateInfo QueryPool create_query_pool "vkCreateQueryPool";
    SemaphoreCreateInfo Semaphore create_semaphore "vkCreateSemaphore";
    ShaderModuleCreateInfo ShaderModule create_shader_module "vkCreateShaderModule";
}

macro_rules! pipelines {
    ($($info:ident $create:ident $call:literal;)*) => {$(
        impl Description for vk::$info<'_> {
            type Object = vk::Pipeline;
            const CALL: &'static str = $call;

            unsafe fn make(
                &self,
                device: &ash::Device,
                callbacks: Callbacks,
            ) -> VkResult<vk::Pipeline> {
                // SAFETY: as the caller ensures.
                let made =
                    unsafe { device.$create(vk::PipelineCache::null(), &[*self], callbacks) };
                made.map(|pipelines| pipelines[0]).map_err(|(_, code)| code)
            }
        }
    )*};
}

pipelines! {
    ComputePipelineCreateInfo create_compute_pipelines "vkCreateComputePipelines";
    GraphicsPipelineCreateInfo create_graphics_pipelines "vkCreateGraphicsPipelines";
}
