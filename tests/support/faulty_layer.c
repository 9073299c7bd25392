// A Vulkan layer that lets one call fail, or loses the device at one, or hides what a device has,
// for tests of the program.
//
// In: the environment.
//   FAULT_AT=N        the N-th call that may fail does, counted from 1 over all threads
//   FAULT_LOSES=1     that call, and all after it that a lost device fails, say that it is lost
//   FAULT_LOG=FILE    names of calls are appended there: of the failed one, or of all without FAULT_AT
//   HIDDEN=NAME,...   the device lacks these features
//   LIMITS=NAME=N,... the device has these limits, and apiVersion or timestampValidBits
// What fails does not reach the layers below, nor the driver, but for what waits for a lost device.

#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <vulkan/vk_layer.h>
#include <vulkan/vulkan.h>

static atomic_long calls;
static atomic_bool lost;

static void say(const char *name) {
    const char *path = getenv("FAULT_LOG");
    FILE *log = path ? fopen(path, "a") : NULL;
    if (log) {
        fprintf(log, "%s\n", name);
        fclose(log);
    }
}

// Returns whether this call fails. Only some say that the device is lost.
static bool fails(const char *name, bool can_lose) {
    const char *at = getenv("FAULT_AT");
    const bool loses = getenv("FAULT_LOSES") != NULL;
    if (loses && !can_lose) {
        return false;
    }
    const long call = atomic_fetch_add(&calls, 1) + 1;
    if (at == NULL) {
        say(name);
        return false;
    }
    if (call == atol(at)) {
        say(name);
        atomic_store(&lost, loses);
        return true;
    }
    return atomic_load(&lost);
}

static VkResult code(VkResult usual) {
    return atomic_load(&lost) ? VK_ERROR_DEVICE_LOST : usual;
}

// Returns whether a call of a lost device goes on to the driver: nothing of a lost device is in
// flight, which the driver and the layers below know only then.
static bool waits(const char *name) {
    return atomic_load(&lost) && strstr(name, "Wait");
}

static PFN_vkGetInstanceProcAddr next_instance_function;
static PFN_vkGetDeviceProcAddr next_device_function;

// Functions that may fail: name, whether they report a lost device, error, parameters, arguments.
#define OOM VK_ERROR_OUT_OF_DEVICE_MEMORY
#define ALLOCATOR const VkAllocationCallbacks *callbacks
#define CREATE(X, what)                                                                            \
    X(vkCreate##what, false, OOM,                                                                  \
      (VkDevice device, const Vk##what##CreateInfo *info, ALLOCATOR, Vk##what *made),              \
      (device, info, callbacks, made))
#define DEVICE_FUNCTIONS(X)                                                                        \
    CREATE(X, Buffer)                                                                              \
    CREATE(X, BufferView)                                                                          \
    CREATE(X, Image)                                                                               \
    CREATE(X, ImageView)                                                                           \
    CREATE(X, Fence)                                                                               \
    CREATE(X, Semaphore)                                                                           \
    CREATE(X, CommandPool)                                                                         \
    CREATE(X, QueryPool)                                                                           \
    CREATE(X, DescriptorPool)                                                                      \
    CREATE(X, DescriptorSetLayout)                                                                 \
    CREATE(X, PipelineLayout)                                                                      \
    CREATE(X, ShaderModule)                                                                        \
    CREATE(X, Sampler)                                                                             \
    X(vkCreateSwapchainKHR, false, OOM,                                                            \
      (VkDevice device, const VkSwapchainCreateInfoKHR *info, ALLOCATOR, VkSwapchainKHR *made),    \
      (device, info, callbacks, made))                                                             \
    X(vkGetSwapchainImagesKHR, false, OOM,                                                         \
      (VkDevice device, VkSwapchainKHR swapchain, uint32_t *count, VkImage *images),               \
      (device, swapchain, count, images))                                                          \
    X(vkAcquireNextImageKHR, true, OOM,                                                            \
      (VkDevice device, VkSwapchainKHR swapchain, uint64_t timeout, VkSemaphore semaphore,         \
       VkFence fence, uint32_t *image),                                                            \
      (device, swapchain, timeout, semaphore, fence, image))                                       \
    X(vkCreateComputePipelines, false, OOM,                                                        \
      (VkDevice device, VkPipelineCache cache, uint32_t count,                                     \
       const VkComputePipelineCreateInfo *infos, ALLOCATOR, VkPipeline *made),                     \
      (device, cache, count, infos, callbacks, made))                                              \
    X(vkCreateGraphicsPipelines, false, OOM,                                                       \
      (VkDevice device, VkPipelineCache cache, uint32_t count,                                     \
       const VkGraphicsPipelineCreateInfo *infos, ALLOCATOR, VkPipeline *made),                    \
      (device, cache, count, infos, callbacks, made))                                              \
    X(vkAllocateMemory, false, OOM,                                                                \
      (VkDevice device, const VkMemoryAllocateInfo *info, ALLOCATOR, VkDeviceMemory *made),        \
      (device, info, callbacks, made))                                                             \
    X(vkMapMemory, false, VK_ERROR_MEMORY_MAP_FAILED,                                              \
      (VkDevice device, VkDeviceMemory memory, VkDeviceSize at, VkDeviceSize size,                 \
       VkMemoryMapFlags flags, void **map),                                                        \
      (device, memory, at, size, flags, map))                                                      \
    X(vkBindBufferMemory, false, OOM,                                                              \
      (VkDevice device, VkBuffer buffer, VkDeviceMemory memory, VkDeviceSize at),                  \
      (device, buffer, memory, at))                                                                \
    X(vkBindImageMemory, false, OOM,                                                               \
      (VkDevice device, VkImage image, VkDeviceMemory memory, VkDeviceSize at),                    \
      (device, image, memory, at))                                                                 \
    X(vkAllocateDescriptorSets, false, OOM,                                                        \
      (VkDevice device, const VkDescriptorSetAllocateInfo *info, VkDescriptorSet *sets),           \
      (device, info, sets))                                                                        \
    X(vkAllocateCommandBuffers, false, OOM,                                                        \
      (VkDevice device, const VkCommandBufferAllocateInfo *info, VkCommandBuffer *made),           \
      (device, info, made))                                                                        \
    X(vkBeginCommandBuffer, false, OOM,                                                            \
      (VkCommandBuffer commands, const VkCommandBufferBeginInfo *info), (commands, info))          \
    X(vkEndCommandBuffer, false, OOM, (VkCommandBuffer commands), (commands))                      \
    X(vkResetCommandPool, false, OOM,                                                              \
      (VkDevice device, VkCommandPool pool, VkCommandPoolResetFlags flags),                        \
      (device, pool, flags))                                                                       \
    X(vkQueueSubmit2, true, OOM,                                                                   \
      (VkQueue queue, uint32_t count, const VkSubmitInfo2 *submits, VkFence fence),                \
      (queue, count, submits, fence))                                                              \
    X(vkQueuePresentKHR, true, OOM, (VkQueue queue, const VkPresentInfoKHR *info), (queue, info))  \
    X(vkWaitForFences, true, OOM,                                                                  \
      (VkDevice device, uint32_t count, const VkFence *fences, VkBool32 all, uint64_t timeout),    \
      (device, count, fences, all, timeout))                                                       \
    X(vkGetFenceStatus, true, OOM, (VkDevice device, VkFence fence), (device, fence))              \
    X(vkResetFences, false, OOM, (VkDevice device, uint32_t count, const VkFence *fences),         \
      (device, count, fences))                                                                     \
    X(vkGetQueryPoolResults, true, OOM,                                                            \
      (VkDevice device, VkQueryPool pool, uint32_t first, uint32_t count, size_t size, void *data, \
       VkDeviceSize stride, VkQueryResultFlags flags),                                             \
      (device, pool, first, count, size, data, stride, flags))                                     \
    X(vkSignalSemaphore, false, OOM, (VkDevice device, const VkSemaphoreSignalInfo *info),         \
      (device, info))                                                                              \
    X(vkWaitSemaphores, true, OOM,                                                                 \
      (VkDevice device, const VkSemaphoreWaitInfo *info, uint64_t timeout),                        \
      (device, info, timeout))                                                                     \
    X(vkGetSemaphoreCounterValue, true, OOM,                                                       \
      (VkDevice device, VkSemaphore semaphore, uint64_t *value), (device, semaphore, value))       \
    X(vkDeviceWaitIdle, true, OOM, (VkDevice device), (device))
#define PHYSICAL VkPhysicalDevice physical
#define QUERIES(X)                                                                                 \
    X(vkGetPhysicalDeviceFeatures, (PHYSICAL, VkPhysicalDeviceFeatures *found),                    \
      (physical, found), hide(found, NULL))                                                        \
    X(vkGetPhysicalDeviceFeatures2, (PHYSICAL, VkPhysicalDeviceFeatures2 *found),                  \
      (physical, found), hide(&found->features, found->pNext))                                     \
    X(vkGetPhysicalDeviceFeatures2KHR, (PHYSICAL, VkPhysicalDeviceFeatures2 *found),               \
      (physical, found), hide(&found->features, found->pNext))                                     \
    X(vkGetPhysicalDeviceProperties, (PHYSICAL, VkPhysicalDeviceProperties *found),                \
      (physical, found), limit(found, NULL))                                                       \
    X(vkGetPhysicalDeviceProperties2, (PHYSICAL, VkPhysicalDeviceProperties2 *found),              \
      (physical, found), limit(&found->properties, found->pNext))                                  \
    X(vkGetPhysicalDeviceProperties2KHR, (PHYSICAL, VkPhysicalDeviceProperties2 *found),           \
      (physical, found), limit(&found->properties, found->pNext))                                  \
    X(vkGetPhysicalDeviceQueueFamilyProperties,                                                    \
      (PHYSICAL, uint32_t *count, VkQueueFamilyProperties *found), (physical, count, found),       \
      for (uint32_t i = 0; found && i < *count; ++i) limit_queues(&found[i]))                      \
    X(vkGetPhysicalDeviceQueueFamilyProperties2,                                                   \
      (PHYSICAL, uint32_t *count, VkQueueFamilyProperties2 *found), (physical, count, found),      \
      for (uint32_t i = 0; found && i < *count; ++i) limit_queues(&found[i].queueFamilyProperties))
#define INSTANCE_FUNCTIONS(X)                                                                      \
    X(vkEnumeratePhysicalDevices, false, VK_ERROR_OUT_OF_HOST_MEMORY,                              \
      (VkInstance instance, uint32_t *count, VkPhysicalDevice *devices),                           \
      (instance, count, devices))                                                                  \
    X(vkCreateDebugUtilsMessengerEXT, false, VK_ERROR_OUT_OF_HOST_MEMORY,                          \
      (VkInstance instance, const VkDebugUtilsMessengerCreateInfoEXT *info, ALLOCATOR,             \
       VkDebugUtilsMessengerEXT *made),                                                            \
      (instance, info, callbacks, made))

#define DEFINE(name, can_lose, usual, parameters, arguments)                                       \
    static PFN_##name next_##name;                                                                 \
    static VKAPI_ATTR VkResult VKAPI_CALL own_##name parameters {                                  \
        if (!fails(#name, can_lose)) {                                                             \
            return next_##name arguments;                                                          \
        }                                                                                          \
        if (waits(#name)) {                                                                        \
            (void)next_##name arguments;                                                           \
        }                                                                                          \
        return code(usual);                                                                        \
    }
DEVICE_FUNCTIONS(DEFINE)
INSTANCE_FUNCTIONS(DEFINE)

// Returns what follows a name in a list of the environment; NULL if it is not there.
static const char *listed(const char *variable, const char *name) {
    const size_t length = strlen(name);
    const char *at = getenv(variable);
    while (at && (strncmp(at, name, length) || !strchr(",=", at[length]))) {
        at = strchr(at, ',');
        at = at ? at + 1 : NULL;
    }
    return at ? at + length : NULL;
}

static void hide(VkPhysicalDeviceFeatures *v10, void *next) {
#define HIDE(features, member)                                                                     \
    if (listed("HIDDEN", #member)) {                                                               \
        (features)->member = VK_FALSE;                                                             \
    }
    HIDE(v10, fragmentStoresAndAtomics)
    HIDE(v10, shaderInt64)
    for (VkBaseOutStructure *link = next; link; link = link->pNext) {
        if (link->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES) {
            VkPhysicalDeviceVulkan12Features *v12 = (VkPhysicalDeviceVulkan12Features *)link;
            HIDE(v12, shaderBufferInt64Atomics)
            HIDE(v12, timelineSemaphore)
            HIDE(v12, bufferDeviceAddress)
            HIDE(v12, scalarBlockLayout)
        } else if (link->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES) {
            VkPhysicalDeviceVulkan13Features *v13 = (VkPhysicalDeviceVulkan13Features *)link;
            HIDE(v13, synchronization2)
            HIDE(v13, dynamicRendering)
            HIDE(v13, maintenance4)
            HIDE(v13, robustImageAccess)
            HIDE(v13, shaderDemoteToHelperInvocation)
        }
    }
}

#define SET(place, name)                                                                           \
    if ((value = listed("LIMITS", name))) {                                                        \
        (place) = strtoull(value + 1, NULL, 10);                                                   \
    }
#define LIMIT(limits, member) SET((limits)->member, #member)

static void limit_queues(VkQueueFamilyProperties *family) {
    const char *value;
    LIMIT(family, timestampValidBits)
}

static void limit(VkPhysicalDeviceProperties *properties, void *next) {
    const char *value;
    LIMIT(properties, apiVersion)
    VkPhysicalDeviceLimits *limits = &properties->limits;
    LIMIT(limits, maxImageDimension2D)
    LIMIT(limits, maxTexelBufferElements)
    LIMIT(limits, maxStorageBufferRange)
    LIMIT(limits, maxPushConstantsSize)
    LIMIT(limits, maxMemoryAllocationCount)
    LIMIT(limits, bufferImageGranularity)
    LIMIT(limits, maxBoundDescriptorSets)
    LIMIT(limits, maxPerStageDescriptorStorageBuffers)
    LIMIT(limits, maxPerStageDescriptorStorageImages)
    LIMIT(limits, maxPerStageResources)
    LIMIT(limits, maxDescriptorSetStorageBuffers)
    LIMIT(limits, maxDescriptorSetStorageImages)
    LIMIT(limits, maxVertexInputAttributes)
    LIMIT(limits, maxVertexInputBindings)
    LIMIT(limits, maxVertexOutputComponents)
    LIMIT(limits, maxFragmentInputComponents)
    LIMIT(limits, maxFragmentOutputAttachments)
    LIMIT(limits, maxFragmentCombinedOutputResources)
    LIMIT(limits, maxComputeSharedMemorySize)
    LIMIT(limits, maxComputeWorkGroupInvocations)
    SET(limits->maxComputeWorkGroupCount[0], "maxComputeWorkGroupCount")
    SET(limits->maxComputeWorkGroupCount[1], "maxComputeWorkGroupCount")
    SET(limits->maxComputeWorkGroupCount[2], "maxComputeWorkGroupCount")
    SET(limits->maxComputeWorkGroupSize[0], "maxComputeWorkGroupSize")
    SET(limits->maxComputeWorkGroupSize[1], "maxComputeWorkGroupSize")
    SET(limits->maxComputeWorkGroupSize[2], "maxComputeWorkGroupDepth")
    SET(limits->maxViewportDimensions[0], "maxViewportDimensions")
    SET(limits->maxViewportDimensions[1], "maxViewportDimensions")
    LIMIT(limits, minMemoryMapAlignment)
    LIMIT(limits, minTexelBufferOffsetAlignment)
    LIMIT(limits, minStorageBufferOffsetAlignment)
    LIMIT(limits, maxFramebufferWidth)
    LIMIT(limits, maxFramebufferHeight)
    LIMIT(limits, maxColorAttachments)
    LIMIT(limits, timestampComputeAndGraphics)
    LIMIT(limits, nonCoherentAtomSize)
    for (VkBaseOutStructure *link = next; link; link = link->pNext) {
        if (link->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES) {
            VkPhysicalDeviceMaintenance3Properties *own =
                (VkPhysicalDeviceMaintenance3Properties *)link;
            LIMIT(own, maxPerSetDescriptors)
            LIMIT(own, maxMemoryAllocationSize)
        } else if (link->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_PROPERTIES) {
            VkPhysicalDeviceVulkan11Properties *own = (VkPhysicalDeviceVulkan11Properties *)link;
            LIMIT(own, maxPerSetDescriptors)
            LIMIT(own, maxMemoryAllocationSize)
        } else if (link->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_4_PROPERTIES) {
            LIMIT((VkPhysicalDeviceMaintenance4Properties *)link, maxBufferSize)
        } else if (link->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_PROPERTIES) {
            LIMIT((VkPhysicalDeviceVulkan13Properties *)link, maxBufferSize)
        }
    }
}

#define DEFINE_QUERY(name, parameters, arguments, change)                                          \
    static PFN_##name next_##name;                                                                 \
    static VKAPI_ATTR void VKAPI_CALL own_##name parameters {                                      \
        next_##name arguments;                                                                     \
        change;                                                                                    \
    }
QUERIES(DEFINE_QUERY)

static VKAPI_ATTR VkResult VKAPI_CALL own_vkCreateInstance(const VkInstanceCreateInfo *info,
                                                           ALLOCATOR, VkInstance *made) {
    VkLayerInstanceCreateInfo *link = (VkLayerInstanceCreateInfo *)info->pNext;
    while (link && (link->sType != VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO ||
                    link->function != VK_LAYER_LINK_INFO)) {
        link = (VkLayerInstanceCreateInfo *)link->pNext;
    }
    next_instance_function = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    if (fails("vkCreateInstance", false)) {
        return VK_ERROR_OUT_OF_HOST_MEMORY;
    }
    const PFN_vkCreateInstance next =
        (PFN_vkCreateInstance)next_instance_function(NULL, "vkCreateInstance");
    const VkResult result = next(info, callbacks, made);
    if (result == VK_SUCCESS) {
#define LOAD_OF_INSTANCE(name, can_lose, usual, parameters, arguments)                             \
    next_##name = (PFN_##name)next_instance_function(*made, #name);
        INSTANCE_FUNCTIONS(LOAD_OF_INSTANCE)
#define LOAD_QUERY(name, parameters, arguments, change)                                            \
    LOAD_OF_INSTANCE(name, false, 0, parameters, arguments)
        QUERIES(LOAD_QUERY)
    }
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL own_vkCreateDevice(VkPhysicalDevice physical,
                                                         const VkDeviceCreateInfo *info, ALLOCATOR,
                                                         VkDevice *made) {
    VkLayerDeviceCreateInfo *link = (VkLayerDeviceCreateInfo *)info->pNext;
    while (link && (link->sType != VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO ||
                    link->function != VK_LAYER_LINK_INFO)) {
        link = (VkLayerDeviceCreateInfo *)link->pNext;
    }
    const PFN_vkGetInstanceProcAddr of_instance =
        link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    next_device_function = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    if (fails("vkCreateDevice", false)) {
        return VK_ERROR_OUT_OF_HOST_MEMORY;
    }
    const PFN_vkCreateDevice next = (PFN_vkCreateDevice)of_instance(NULL, "vkCreateDevice");
    const VkResult result = next(physical, info, callbacks, made);
    if (result == VK_SUCCESS) {
        atomic_store(&lost, false);
#define LOAD_OF_DEVICE(name, can_lose, usual, parameters, arguments)                               \
    next_##name = (PFN_##name)next_device_function(*made, #name);
        DEVICE_FUNCTIONS(LOAD_OF_DEVICE)
    }
    return result;
}

VK_LAYER_EXPORT VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL vkGetDeviceProcAddr(VkDevice device,
                                                                             const char *name) {
    if (strcmp(name, "vkGetDeviceProcAddr") == 0) {
        return (PFN_vkVoidFunction)vkGetDeviceProcAddr;
    }
#define FIND(function, can_lose, usual, parameters, arguments)                                     \
    if (strcmp(name, #function) == 0 && next_##function) {                                         \
        return (PFN_vkVoidFunction)own_##function;                                                 \
    }
    DEVICE_FUNCTIONS(FIND)
    return next_device_function(device, name);
}

VK_LAYER_EXPORT VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL vkGetInstanceProcAddr(VkInstance instance,
                                                                               const char *name) {
    if (strcmp(name, "vkGetInstanceProcAddr") == 0) {
        return (PFN_vkVoidFunction)vkGetInstanceProcAddr;
    }
    if (strcmp(name, "vkGetDeviceProcAddr") == 0) {
        return (PFN_vkVoidFunction)vkGetDeviceProcAddr;
    }
    if (strcmp(name, "vkCreateInstance") == 0) {
        return (PFN_vkVoidFunction)own_vkCreateInstance;
    }
    if (strcmp(name, "vkCreateDevice") == 0) {
        return (PFN_vkVoidFunction)own_vkCreateDevice;
    }
    INSTANCE_FUNCTIONS(FIND)
#define FIND_QUERY(function, parameters, arguments, change)                                        \
    FIND(function, false, 0, parameters, arguments)
    QUERIES(FIND_QUERY)
    return next_instance_function ? next_instance_function(instance, name) : NULL;
}
