//! Counts what is alive: Vulkan objects made through a host's `vkGetInstanceProcAddr`, and bytes of
//! the heap.

use ash::vk::{self, Handle};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ffi::{CStr, c_char, c_void};
use std::sync::Mutex;
use std::sync::atomic::{
    AtomicBool, AtomicI32, AtomicI64, AtomicPtr, AtomicU64, Ordering::Relaxed,
};

/// An allocator that counts the bytes of each thread.
pub struct CountingHeap;

thread_local! {
    static LIVE: Cell<i64> = const { Cell::new(0) };
}

/// Returns the bytes that this thread has allocated and not freed.
pub fn heap_bytes() -> i64 {
    LIVE.get()
}

// SAFETY: the system's allocator does all the work.
unsafe impl GlobalAlloc for CountingHeap {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = LIVE.try_with(|live| live.set(live.get() + layout.size() as i64));
        // SAFETY: as the caller ensures.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        let _ = LIVE.try_with(|live| live.set(live.get() - layout.size() as i64));
        // SAFETY: as the caller ensures.
        unsafe { System.dealloc(at, layout) }
    }
}

/// An image barrier that was recorded: each from and to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageBarrier {
    pub image: vk::Image,
    pub layouts: [vk::ImageLayout; 2],
    pub stages: [vk::PipelineStageFlags2; 2],
    pub access: [vk::AccessFlags2; 2],
    pub families: [u32; 2],
}

/// Image barriers recorded through [`get_instance_proc_addr`]; None while they are not asked for.
static BARRIERS: Mutex<Option<Vec<ImageBarrier>>> = Mutex::new(None);

/// Returns the image barriers that `record` records.
pub fn image_barriers(record: impl FnOnce()) -> Vec<ImageBarrier> {
    *BARRIERS.lock().unwrap() = Some(Vec::new());
    record();
    BARRIERS.lock().unwrap().take().unwrap()
}

static BARRIER: Real = Real::new();

unsafe extern "system" fn barrier(commands: vk::CommandBuffer, info: *const vk::DependencyInfo) {
    // SAFETY: as the caller ensures.
    unsafe {
        if let Some(barriers) = &mut *BARRIERS.lock().unwrap() {
            let count = (*info).image_memory_barrier_count as usize;
            let first = (*info).p_image_memory_barriers;
            barriers.extend((0..count).map(|i| {
                let at = &*first.add(i);
                ImageBarrier {
                    image: at.image,
                    layouts: [at.old_layout, at.new_layout],
                    stages: [at.src_stage_mask, at.dst_stage_mask],
                    access: [at.src_access_mask, at.dst_access_mask],
                    families: [at.src_queue_family_index, at.dst_queue_family_index],
                }
            }));
        }
        BARRIER.get::<vk::PFN_vkCmdPipelineBarrier2>()(commands, info)
    }
}

/// Objects that are alive, and all that were ever made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Objects {
    pub alive: i64,
    pub made: u64,
}

static ALIVE: AtomicI64 = AtomicI64::new(0);
static MADE: AtomicU64 = AtomicU64::new(0);
static INSTANCE_FUNCTION: Real = Real::new();
static DEVICE_FUNCTION: Real = Real::new();

/// The function that is counted. Every device sets it again: layers are loaded with an instance.
struct Real(AtomicPtr<c_void>);

impl Real {
    const fn new() -> Real {
        Real(AtomicPtr::new(std::ptr::null_mut()))
    }

    fn set(&self, function: unsafe extern "system" fn()) {
        self.0.store(function as *mut c_void, Relaxed);
    }

    /// # Safety
    /// `F` is the type of the function that was set.
    unsafe fn get<F: Copy>(&self) -> F {
        let function = self.0.load(Relaxed);
        assert!(!function.is_null() && size_of::<F>() == size_of_val(&function));
        // SAFETY: as the caller ensures.
        unsafe { std::mem::transmute_copy(&function) }
    }
}

/// Returns the objects made through [`get_instance_proc_addr`].
pub fn objects() -> Objects {
    Objects { alive: ALIVE.load(Relaxed), made: MADE.load(Relaxed) }
}

/// Returns a `vkGetInstanceProcAddr` whose device functions are counted.
pub fn get_instance_proc_addr(of: vk::PFN_vkGetInstanceProcAddr) -> *const c_void {
    // SAFETY: only its address is kept.
    INSTANCE_FUNCTION.set(unsafe {
        std::mem::transmute::<vk::PFN_vkGetInstanceProcAddr, unsafe extern "system" fn()>(of)
    });
    counted_instance_function as vk::PFN_vkGetInstanceProcAddr as *const c_void
}

unsafe extern "system" fn counted_instance_function(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    // SAFETY: as the caller ensures.
    unsafe {
        let found = INSTANCE_FUNCTION.get::<vk::PFN_vkGetInstanceProcAddr>()(instance, name)?;
        if CStr::from_ptr(name) != c"vkGetDeviceProcAddr" {
            return Some(found);
        }
        DEVICE_FUNCTION.set(found);
        Some(std::mem::transmute::<vk::PFN_vkGetDeviceProcAddr, unsafe extern "system" fn()>(
            counted_device_function,
        ))
    }
}

type Create = unsafe extern "system" fn(u64, *const c_void, *const c_void, *mut u64) -> vk::Result;
type Destroy = unsafe extern "system" fn(u64, u64, *const c_void);
type CreatePipelines =
    unsafe extern "system" fn(u64, u64, u32, *const c_void, *const c_void, *mut u64) -> vk::Result;

/// Checks that an object is made and destroyed with the host's callbacks; device memory, which is
/// from functions of the host, has none.
fn check_callbacks(callbacks: *const c_void, name: &str) {
    assert!(name.ends_with("Memory") || !callbacks.is_null(), "{name} has no callbacks");
}

/// Calls that submit or wait for the device.
static QUEUE_CALLS: AtomicU64 = AtomicU64::new(0);

/// Returns how many calls submitted work, waited for the device, or were of its queues.
pub fn queue_calls() -> u64 {
    QUEUE_CALLS.load(Relaxed)
}

macro_rules! counted_calls {
    ($($name:ident $place:ident $function:ident $type:ident ($($argument:ident: $of:ty),*);)*) => {
        $(
            static $place: Real = Real::new();
            unsafe extern "system" fn $function($($argument: $of),*) -> vk::Result {
                QUEUE_CALLS.fetch_add(1, Relaxed);
                // SAFETY: as the caller ensures.
                unsafe { $place.get::<vk::$type>()($($argument),*) }
            }
        )*

        /// # Safety
        /// As for [`counted`].
        unsafe fn counted_calls(
            name: &str,
            found: unsafe extern "system" fn(),
        ) -> Option<unsafe extern "system" fn()> {
            $(
                if name == stringify!($name) {
                    $place.set(found);
                    // SAFETY: functions of these names have these types.
                    return Some(unsafe {
                        std::mem::transmute::<vk::$type, unsafe extern "system" fn()>($function)
                    });
                }
            )*
            None
        }
    };
}

counted_calls! {
    vkQueueSubmit SUBMIT submit PFN_vkQueueSubmit
        (queue: vk::Queue, count: u32, first: *const vk::SubmitInfo<'_>, fence: vk::Fence);
    vkQueueSubmit2 SUBMIT2 submit2 PFN_vkQueueSubmit2
        (queue: vk::Queue, count: u32, first: *const vk::SubmitInfo2<'_>, fence: vk::Fence);
    vkQueueBindSparse BIND_SPARSE bind_sparse PFN_vkQueueBindSparse
        (queue: vk::Queue, count: u32, first: *const vk::BindSparseInfo<'_>, fence: vk::Fence);
    vkQueueWaitIdle QUEUE_IDLE queue_idle PFN_vkQueueWaitIdle (queue: vk::Queue);
    vkDeviceWaitIdle DEVICE_IDLE device_idle PFN_vkDeviceWaitIdle (device: vk::Device);
    vkWaitForFences FENCES fences PFN_vkWaitForFences
        (device: vk::Device, count: u32, first: *const vk::Fence, all: vk::Bool32, timeout: u64);
    vkWaitSemaphores SEMAPHORES semaphores PFN_vkWaitSemaphores
        (device: vk::Device, info: *const vk::SemaphoreWaitInfo<'_>, timeout: u64);
}

/// Calls that ask the device, and what they return once it is lost.
static LOST: AtomicBool = AtomicBool::new(false);

/// Has the device be lost, for all calls that can tell, or not.
pub fn lose_device(is_lost: bool) {
    LOST.store(is_lost, Relaxed);
}

static COUNTER_VALUE: Real = Real::new();
static QUERY_RESULTS: Real = Real::new();

unsafe extern "system" fn counter_value(
    device: vk::Device,
    semaphore: vk::Semaphore,
    value: *mut u64,
) -> vk::Result {
    if LOST.load(Relaxed) {
        return vk::Result::ERROR_DEVICE_LOST;
    }
    // SAFETY: as the caller ensures.
    unsafe { COUNTER_VALUE.get::<vk::PFN_vkGetSemaphoreCounterValue>()(device, semaphore, value) }
}

unsafe extern "system" fn query_results(
    device: vk::Device,
    pool: vk::QueryPool,
    first: u32,
    count: u32,
    size: usize,
    data: *mut c_void,
    stride: vk::DeviceSize,
    flags: vk::QueryResultFlags,
) -> vk::Result {
    if LOST.load(Relaxed) {
        return vk::Result::ERROR_DEVICE_LOST;
    }
    // SAFETY: as the caller ensures.
    unsafe {
        QUERY_RESULTS.get::<vk::PFN_vkGetQueryPoolResults>()(
            device, pool, first, count, size, data, stride, flags,
        )
    }
}

/// # Safety
/// As for [`counted`].
unsafe fn losing(
    name: &str,
    found: unsafe extern "system" fn(),
) -> Option<unsafe extern "system" fn()> {
    // SAFETY: functions of these names have these types.
    unsafe {
        match name {
            "vkGetSemaphoreCounterValue" => {
                COUNTER_VALUE.set(found);
                Some(std::mem::transmute::<
                    vk::PFN_vkGetSemaphoreCounterValue,
                    unsafe extern "system" fn(),
                >(counter_value))
            }
            "vkGetQueryPoolResults" => {
                QUERY_RESULTS.set(found);
                Some(std::mem::transmute::<
                    vk::PFN_vkGetQueryPoolResults,
                    unsafe extern "system" fn(),
                >(query_results))
            }
            _ => None,
        }
    }
}

/// Creations that succeed before one is refused; below 0 if none is, or one was.
static LEFT: AtomicI64 = AtomicI64::new(-1);
static REFUSAL: AtomicI32 = AtomicI32::new(0);

/// Has one creation fail after this many others, until [`accept`].
pub fn refuse(after: u64, code: vk::Result) {
    REFUSAL.store(code.as_raw(), Relaxed);
    LEFT.store(after as i64, Relaxed);
}

/// Refuses none from now on. Returns whether one was refused.
pub fn accept() -> bool {
    LEFT.swap(-1, Relaxed) < 0
}

/// Returns what a creation fails with, if it is to fail.
fn refused() -> Option<vk::Result> {
    let is_refused = LEFT.load(Relaxed) >= 0 && LEFT.fetch_sub(1, Relaxed) == 0;
    is_refused.then(|| vk::Result::from_raw(REFUSAL.load(Relaxed)))
}

fn count(result: vk::Result, made: u32) -> vk::Result {
    if result == vk::Result::SUCCESS {
        ALIVE.fetch_add(made as i64, Relaxed);
        MADE.fetch_add(made as u64, Relaxed);
    }
    result
}

macro_rules! counted {
    ($($create:ident $destroy:ident;)*) => {
        #[allow(non_snake_case, reason = "names of Vulkan")]
        mod of {
            use super::*;
            $(
                pub mod $create {
                    use super::*;
                    pub static CREATE: Real = Real::new();
                    pub static DESTROY: Real = Real::new();
                    pub unsafe extern "system" fn create(
                        device: u64,
                        info: *const c_void,
                        callbacks: *const c_void,
                        out: *mut u64,
                    ) -> vk::Result {
                        check_callbacks(callbacks, stringify!($create));
                        if let Some(code) = refused() {
                            return code;
                        }
                        // SAFETY: as the caller ensures.
                        count(unsafe { CREATE.get::<Create>()(device, info, callbacks, out) }, 1)
                    }
                    pub unsafe extern "system" fn destroy(
                        device: u64,
                        object: u64,
                        callbacks: *const c_void,
                    ) {
                        check_callbacks(callbacks, stringify!($destroy));
                        ALIVE.fetch_sub((object != 0) as i64, Relaxed);
                        // SAFETY: as the caller ensures.
                        unsafe { DESTROY.get::<Destroy>()(device, object, callbacks) }
                    }
                }
            )*
        }

        /// Returns the counted function of this name.
        ///
        /// # Safety
        /// `found` is that function.
        unsafe fn counted(
            name: &str,
            found: unsafe extern "system" fn(),
        ) -> Option<unsafe extern "system" fn()> {
            // SAFETY: functions of these names have these types.
            unsafe {
                $(
                    if name == stringify!($create) {
                        of::$create::CREATE.set(found);
                        return Some(std::mem::transmute::<Create, unsafe extern "system" fn()>(
                            of::$create::create,
                        ));
                    }
                    if name == stringify!($destroy) {
                        of::$create::DESTROY.set(found);
                        return Some(std::mem::transmute::<Destroy, unsafe extern "system" fn()>(
                            of::$create::destroy,
                        ));
                    }
                )*
            }
            None
        }
    };
}

counted! {
    vkCreateBuffer vkDestroyBuffer;
    vkCreateBufferView vkDestroyBufferView;
    vkCreateImage vkDestroyImage;
    vkCreateImageView vkDestroyImageView;
    vkAllocateMemory vkFreeMemory;
    vkCreateFence vkDestroyFence;
    vkCreateSemaphore vkDestroySemaphore;
    vkCreateCommandPool vkDestroyCommandPool;
    vkCreateQueryPool vkDestroyQueryPool;
    vkCreateDescriptorPool vkDestroyDescriptorPool;
    vkCreateDescriptorSetLayout vkDestroyDescriptorSetLayout;
    vkCreatePipelineLayout vkDestroyPipelineLayout;
    vkCreateShaderModule vkDestroyShaderModule;
    vkCreatePipelineCache vkDestroyPipelineCache;
}

macro_rules! counted_pipelines {
    ($($name:ident $place:ident $function:ident;)*) => {
        $(
            static $place: Real = Real::new();
            unsafe extern "system" fn $function(
                device: u64,
                cache: u64,
                infos: u32,
                info: *const c_void,
                callbacks: *const c_void,
                out: *mut u64,
            ) -> vk::Result {
                check_callbacks(callbacks, stringify!($name));
                if let Some(code) = refused() {
                    // SAFETY: there is room for a handle of each.
                    unsafe { out.write_bytes(0, infos as usize) };
                    return code;
                }
                // SAFETY: as the caller ensures.
                let result = unsafe {
                    $place.get::<CreatePipelines>()(device, cache, infos, info, callbacks, out)
                };
                count(result, infos)
            }
        )*

        /// # Safety
        /// As for [`counted`].
        unsafe fn counted_pipelines(
            name: &str,
            found: unsafe extern "system" fn(),
        ) -> Option<unsafe extern "system" fn()> {
            // SAFETY: functions of these names have this type.
            unsafe {
                $(
                    if name == stringify!($name) {
                        $place.set(found);
                        return Some(
                            std::mem::transmute::<CreatePipelines, unsafe extern "system" fn()>(
                                $function,
                            ),
                        );
                    }
                )*
            }
            None
        }
    };
}

counted_pipelines! {
    vkCreateGraphicsPipelines GRAPHICS graphics;
    vkCreateComputePipelines COMPUTE compute;
}

static DESTROY_PIPELINE: Real = Real::new();

unsafe extern "system" fn destroy_pipeline(device: u64, object: u64, callbacks: *const c_void) {
    check_callbacks(callbacks, "vkDestroyPipeline");
    ALIVE.fetch_sub((object != 0) as i64, Relaxed);
    // SAFETY: as the caller ensures.
    unsafe { DESTROY_PIPELINE.get::<Destroy>()(device, object, callbacks) }
}

unsafe extern "system" fn counted_device_function(
    device: vk::Device,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    // SAFETY: as the caller ensures.
    unsafe {
        let found = DEVICE_FUNCTION.get::<vk::PFN_vkGetDeviceProcAddr>()(device, name)?;
        let name = CStr::from_ptr(name).to_str().unwrap_or_default();
        debug_assert!(device.as_raw() != 0);
        if name == "vkDestroyPipeline" {
            DESTROY_PIPELINE.set(found);
            return Some(std::mem::transmute::<Destroy, unsafe extern "system" fn()>(
                destroy_pipeline,
            ));
        }
        if name == "vkCmdPipelineBarrier2" {
            BARRIER.set(found);
            return Some(std::mem::transmute::<
                vk::PFN_vkCmdPipelineBarrier2,
                unsafe extern "system" fn(),
            >(barrier));
        }
        counted(name, found)
            .or_else(|| counted_pipelines(name, found))
            .or_else(|| counted_calls(name, found))
            .or_else(|| losing(name, found))
            .or(Some(found))
    }
}

/// Allocation callbacks that count.
pub struct Callbacks(vk::AllocationCallbacks<'static>);

// SAFETY: the functions are called on any thread.
unsafe impl Sync for Callbacks {}

impl Callbacks {
    pub fn address(&self) -> *const c_void {
        (&raw const self.0).cast()
    }
}

pub static CALLBACKS: Callbacks = Callbacks(vk::AllocationCallbacks {
    p_user_data: std::ptr::null_mut(),
    pfn_allocation: Some(allocate),
    pfn_reallocation: Some(reallocate),
    pfn_free: Some(free),
    pfn_internal_allocation: None,
    pfn_internal_free: None,
    _marker: std::marker::PhantomData,
});

static ALLOCATED: AtomicI64 = AtomicI64::new(0);
static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

/// Returns the allocations of [`CALLBACKS`].
pub fn allocations() -> Objects {
    Objects { alive: ALLOCATED.load(Relaxed), made: ALLOCATIONS.load(Relaxed) }
}

/// Bytes before each allocation, which hold its size and alignment.
const HEADER: usize = 64;

fn layout(size: usize, align: usize) -> Layout {
    assert!(align <= HEADER);
    Layout::from_size_align(size + HEADER, HEADER).unwrap()
}

unsafe extern "system" fn allocate(
    _: *mut c_void,
    size: usize,
    align: usize,
    _: vk::SystemAllocationScope,
) -> *mut c_void {
    ALLOCATED.fetch_add(1, Relaxed);
    ALLOCATIONS.fetch_add(1, Relaxed);
    // SAFETY: the header lies before what is returned.
    unsafe {
        let at = std::alloc::alloc(layout(size, align));
        at.cast::<[usize; 2]>().write([size, align]);
        at.add(HEADER).cast()
    }
}

unsafe extern "system" fn reallocate(
    data: *mut c_void,
    old: *mut c_void,
    size: usize,
    align: usize,
    scope: vk::SystemAllocationScope,
) -> *mut c_void {
    // SAFETY: `old` is null or from `allocate`.
    unsafe {
        let new = if size == 0 { std::ptr::null_mut() } else { allocate(data, size, align, scope) };
        if !old.is_null() {
            let [before, _] = old.cast::<u8>().sub(HEADER).cast::<[usize; 2]>().read();
            if !new.is_null() {
                std::ptr::copy_nonoverlapping(old.cast::<u8>(), new.cast::<u8>(), before.min(size));
            }
            free(data, old);
        }
        new
    }
}

unsafe extern "system" fn free(_: *mut c_void, at: *mut c_void) {
    if at.is_null() {
        return;
    }
    ALLOCATED.fetch_sub(1, Relaxed);
    // SAFETY: from `allocate`.
    unsafe {
        let start = at.cast::<u8>().sub(HEADER);
        let [size, align] = start.cast::<[usize; 2]>().read();
        std::alloc::dealloc(start, layout(size, align));
    }
}
