// A Vulkan layer that lets one call fail, or loses the device at one, or hides what a device has,
// or shows a queue family that it has not, for tests.
//
// In: the environment.
//   FAULT_AT=N        the N-th call that may fail does, counted from 1 over all threads
//   FAULT_LOSES=1     that call, and all after it that a lost device fails, say that it is lost
//   FAULT_LOG=FILE    names of calls are appended there: of the failed one, or of all without FAULT_AT
//   HIDDEN=NAME,...   the device lacks these features
//   LIMITS=NAME=N,... the device has these limits, and apiVersion or timestampValidBits
//   SHOWN=1           the device has one more queue family, the last, which is as the first
// What fails does not reach the layers below, nor the driver, but for what waits for a lost device.
//
// Queues of the shown family are those of the first below this layer, under handles of their own:
// below, nothing changes its owner, and each half of a transfer changes the layout of its image,
// which drivers without layouts do not mind. They complete in the order of submission, so that a
// wait for work that another queue is given later never ends.

#include <pthread.h>
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

// The shown family, whose queues are those of family 0; no family if none is shown.
#define NO_FAMILY (VK_QUEUE_FAMILY_EXTERNAL - 2)
static uint32_t shown_family = NO_FAMILY;

static uint32_t real_family(uint32_t family) {
    return family == shown_family ? 0 : family;
}

// A queue of the shown family. The loader reads and writes the first word of each queue.
typedef struct ShownQueue {
    void *dispatch;
    VkQueue real;
    struct ShownQueue *next;
} ShownQueue;
static ShownQueue *shown_queues;
static pthread_mutex_t list_lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_mutex_t queue_lock = PTHREAD_MUTEX_INITIALIZER;

// Returns the handle that stands for a queue in the shown family.
static VkQueue shown_queue(VkDevice device, VkQueue real) {
    pthread_mutex_lock(&list_lock);
    ShownQueue *queue = shown_queues;
    while (queue && queue->real != real) {
        queue = queue->next;
    }
    if (queue == NULL) {
        queue = malloc(sizeof *queue);
        *queue = (ShownQueue){.real = real, .next = shown_queues};
        shown_queues = queue;
    }
    queue->dispatch = *(void **)device;
    pthread_mutex_unlock(&list_lock);
    return (VkQueue)queue;
}

static VkQueue real_queue(VkQueue queue) {
    pthread_mutex_lock(&list_lock);
    const ShownQueue *found = shown_queues;
    while (found && found != (const ShownQueue *)queue) {
        found = found->next;
    }
    pthread_mutex_unlock(&list_lock);
    return found ? found->real : queue;
}

// Holds the queues for a call that uses one: two of them may be one below.
static void hold_queues(const char *name) {
    if (strncmp(name, "vkQueue", strlen("vkQueue")) == 0) {
        pthread_mutex_lock(&queue_lock);
    }
}

static void release_queues(const char *name) {
    if (strncmp(name, "vkQueue", strlen("vkQueue")) == 0) {
        pthread_mutex_unlock(&queue_lock);
    }
}

// Returns what an object is created from, for one family instead of two.
#define OF_REAL_FAMILIES(What)                                                                     \
    static const Vk##What *real_##What(const Vk##What *info) {                                     \
        static _Thread_local Vk##What copy;                                                        \
        bool shares = info->SHARING == VK_SHARING_MODE_CONCURRENT;                                 \
        for (uint32_t i = 0; shares && i < info->queueFamilyIndexCount; ++i) {                     \
            shares = info->pQueueFamilyIndices[i] == 0 ||                                          \
                     info->pQueueFamilyIndices[i] == shown_family;                                 \
        }                                                                                          \
        if (!shares || shown_family == NO_FAMILY) {                                                \
            return info;                                                                           \
        }                                                                                          \
        copy = *info;                                                                              \
        copy.SHARING = VK_SHARING_MODE_EXCLUSIVE;                                                  \
        copy.queueFamilyIndexCount = 0;                                                            \
        return &copy;                                                                              \
    }
#define SHARING sharingMode
OF_REAL_FAMILIES(BufferCreateInfo)
OF_REAL_FAMILIES(ImageCreateInfo)
#undef SHARING
#define SHARING imageSharingMode
OF_REAL_FAMILIES(SwapchainCreateInfoKHR)
#undef SHARING

static const VkCommandPoolCreateInfo *real_CommandPoolCreateInfo(
    const VkCommandPoolCreateInfo *info) {
    static _Thread_local VkCommandPoolCreateInfo copy;
    copy = *info;
    copy.queueFamilyIndex = real_family(info->queueFamilyIndex);
    return &copy;
}

// Functions that may fail: name, whether they report a lost device, error, parameters, arguments.
#define OOM VK_ERROR_OUT_OF_DEVICE_MEMORY
#define ALLOCATOR const VkAllocationCallbacks *callbacks
#define CREATE_OF(X, what, info_below)                                                             \
    X(vkCreate##what, false, OOM,                                                                  \
      (VkDevice device, const Vk##what##CreateInfo *info, ALLOCATOR, Vk##what *made),              \
      (device, info_below, callbacks, made))
#define CREATE(X, what) CREATE_OF(X, what, info)
#define DEVICE_FUNCTIONS(X)                                                                        \
    CREATE_OF(X, Buffer, real_BufferCreateInfo(info))                                              \
    CREATE(X, BufferView)                                                                          \
    CREATE_OF(X, Image, real_ImageCreateInfo(info))                                                \
    CREATE(X, ImageView)                                                                           \
    CREATE(X, Fence)                                                                               \
    CREATE(X, Semaphore)                                                                           \
    CREATE_OF(X, CommandPool, real_CommandPoolCreateInfo(info))                                    \
    CREATE(X, QueryPool)                                                                           \
    CREATE(X, DescriptorPool)                                                                      \
    CREATE(X, DescriptorSetLayout)                                                                 \
    CREATE(X, PipelineLayout)                                                                      \
    CREATE(X, ShaderModule)                                                                        \
    CREATE(X, Sampler)                                                                             \
    X(vkCreateSwapchainKHR, false, OOM,                                                            \
      (VkDevice device, const VkSwapchainCreateInfoKHR *info, ALLOCATOR, VkSwapchainKHR *made),    \
      (device, real_SwapchainCreateInfoKHR(info), callbacks, made))                                \
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
    X(vkQueueSubmit, true, OOM,                                                                    \
      (VkQueue queue, uint32_t count, const VkSubmitInfo *submits, VkFence fence),                 \
      (real_queue(queue), count, submits, fence))                                                  \
    X(vkQueueSubmit2, true, OOM,                                                                   \
      (VkQueue queue, uint32_t count, const VkSubmitInfo2 *submits, VkFence fence),                \
      (real_queue(queue), count, submits, fence))                                                  \
    X(vkQueueWaitIdle, true, OOM, (VkQueue queue), (real_queue(queue)))                            \
    X(vkQueuePresentKHR, true, OOM, (VkQueue queue, const VkPresentInfoKHR *info),                 \
      (real_queue(queue), info))                                                                   \
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
      (physical, found), limit(&found->properties, found->pNext))
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
        const bool fault = fails(#name, can_lose);                                                 \
        VkResult result = VK_SUCCESS;                                                              \
        if (!fault || waits(#name)) {                                                              \
            hold_queues(#name);                                                                    \
            result = next_##name arguments;                                                        \
            release_queues(#name);                                                                 \
        }                                                                                          \
        return fault ? code(usual) : result;                                                       \
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

#define FAMILY_QUERIES(X)                                                                          \
    X(vkGetPhysicalDeviceQueueFamilyProperties, VkQueueFamilyProperties, found[i])                 \
    X(vkGetPhysicalDeviceQueueFamilyProperties2, VkQueueFamilyProperties2,                         \
      found[i].queueFamilyProperties)                                                              \
    X(vkGetPhysicalDeviceQueueFamilyProperties2KHR, VkQueueFamilyProperties2,                      \
      found[i].queueFamilyProperties)
#define DEFINE_FAMILY_QUERY(name, Properties, properties)                                          \
    static PFN_##name next_##name;                                                                 \
    static VKAPI_ATTR void VKAPI_CALL own_##name(PHYSICAL, uint32_t *count, Properties *found) {   \
        const bool shows = getenv("SHOWN");                                                        \
        const uint32_t room = *count;                                                              \
        next_##name(physical, count, found);                                                       \
        if (shows && found == NULL) {                                                              \
            ++*count;                                                                              \
        } else if (shows && *count < room) {                                                       \
            uint32_t first = 1;                                                                    \
            next_##name(physical, &first, found + *count);                                         \
            ++*count;                                                                              \
        }                                                                                          \
        for (uint32_t i = 0; found && i < *count; ++i) {                                           \
            limit_queues(&properties);                                                             \
        }                                                                                          \
    }
FAMILY_QUERIES(DEFINE_FAMILY_QUERY)

static void find_shown_family(PHYSICAL) {
    if (getenv("SHOWN")) {
        next_vkGetPhysicalDeviceQueueFamilyProperties(physical, &shown_family, NULL);
    }
}

static PFN_vkGetPhysicalDeviceSurfaceSupportKHR next_vkGetPhysicalDeviceSurfaceSupportKHR;
static VKAPI_ATTR VkResult VKAPI_CALL own_vkGetPhysicalDeviceSurfaceSupportKHR(
    PHYSICAL, uint32_t family, VkSurfaceKHR surface, VkBool32 *supported) {
    find_shown_family(physical);
    return next_vkGetPhysicalDeviceSurfaceSupportKHR(physical, real_family(family), surface,
                                                     supported);
}

// Device functions that name a family, and return nothing: name, parameters, the call below.
#define FAMILY_COMMANDS(X)                                                                         \
    X(vkGetDeviceQueue,                                                                            \
      (VkDevice device, uint32_t family, uint32_t index, VkQueue *queue),                          \
      next(device, real_family(family), index, queue);                                             \
      *queue = family == shown_family ? shown_queue(device, *queue) : *queue)                      \
    X(vkGetDeviceQueue2, (VkDevice device, const VkDeviceQueueInfo2 *info, VkQueue *queue),        \
      VkDeviceQueueInfo2 below = *info;                                                            \
      below.queueFamilyIndex = real_family(info->queueFamilyIndex); next(device, &below, queue);   \
      *queue = info->queueFamilyIndex == shown_family ? shown_queue(device, *queue) : *queue)      \
    X(vkCmdPipelineBarrier,                                                                        \
      (VkCommandBuffer commands, VkPipelineStageFlags before, VkPipelineStageFlags after,          \
       VkDependencyFlags flags, uint32_t count, const VkMemoryBarrier *memory,                     \
       uint32_t buffer_count, const VkBufferMemoryBarrier *buffers, uint32_t image_count,          \
       const VkImageMemoryBarrier *images),                                                        \
      VkBufferMemoryBarrier *own_buffers = real_VkBufferMemoryBarrier(buffer_count, buffers);      \
      VkImageMemoryBarrier *own_images = real_VkImageMemoryBarrier(image_count, images);           \
      next(commands, before, after, flags, count, memory, buffer_count, own_buffers, image_count,  \
           own_images);                                                                            \
      free(own_buffers); free(own_images))                                                         \
    X(vkCmdPipelineBarrier2, (VkCommandBuffer commands, const VkDependencyInfo *info),             \
      VkDependencyInfo below = *info;                                                              \
      VkBufferMemoryBarrier2 *buffers = real_VkBufferMemoryBarrier2(                               \
          info->bufferMemoryBarrierCount, info->pBufferMemoryBarriers);                            \
      VkImageMemoryBarrier2 *images = real_VkImageMemoryBarrier2(info->imageMemoryBarrierCount,    \
                                                                 info->pImageMemoryBarriers);      \
      below.pBufferMemoryBarriers = buffers; below.pImageMemoryBarriers = images;                  \
      next(commands, &below); free(buffers); free(images))

// Returns barriers that transfer between families below.
#define OF_REAL_BARRIERS(Barrier)                                                                  \
    static Barrier *real_##Barrier(uint32_t count, const Barrier *barriers) {                      \
        Barrier *own = calloc(count + 1, sizeof *own);                                             \
        for (uint32_t i = 0; i < count; ++i) {                                                     \
            own[i] = barriers[i];                                                                  \
            own[i].srcQueueFamilyIndex = real_family(own[i].srcQueueFamilyIndex);                  \
            own[i].dstQueueFamilyIndex = real_family(own[i].dstQueueFamilyIndex);                  \
        }                                                                                          \
        return own;                                                                                \
    }
OF_REAL_BARRIERS(VkBufferMemoryBarrier)
OF_REAL_BARRIERS(VkBufferMemoryBarrier2)
OF_REAL_BARRIERS(VkImageMemoryBarrier)
OF_REAL_BARRIERS(VkImageMemoryBarrier2)

#define DEFINE_COMMAND(name, parameters, call)                                                     \
    static PFN_##name next_##name;                                                                 \
    static VKAPI_ATTR void VKAPI_CALL own_##name parameters {                                      \
        const PFN_##name next = next_##name;                                                       \
        call;                                                                                      \
    }
FAMILY_COMMANDS(DEFINE_COMMAND)

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
#define LOAD_FAMILY_QUERY(name, Properties, properties)                                            \
    LOAD_OF_INSTANCE(name, false, 0, (), ())
        FAMILY_QUERIES(LOAD_FAMILY_QUERY)
        LOAD_OF_INSTANCE(vkGetPhysicalDeviceSurfaceSupportKHR, false, 0, (), ())
    }
    return result;
}

// Writes the queues that a device is created with, those of the shown family among those of the
// first. Returns the count of families.
static uint32_t real_queues(const VkDeviceCreateInfo *info, VkDeviceQueueCreateInfo *queues) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < info->queueCreateInfoCount; ++i) {
        VkDeviceQueueCreateInfo own = info->pQueueCreateInfos[i];
        own.queueFamilyIndex = real_family(own.queueFamilyIndex);
        uint32_t at = 0;
        while (at < count && queues[at].queueFamilyIndex != own.queueFamilyIndex) {
            ++at;
        }
        if (at == count || queues[at].queueCount < own.queueCount) {
            queues[at] = own;
        }
        count = at == count ? count + 1 : count;
    }
    return count;
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
    find_shown_family(physical);
    VkDeviceQueueCreateInfo *queues = calloc(info->queueCreateInfoCount, sizeof *queues);
    VkDeviceCreateInfo below = *info;
    below.queueCreateInfoCount = real_queues(info, queues);
    below.pQueueCreateInfos = queues;
    const VkResult result = next(physical, &below, callbacks, made);
    free(queues);
    if (result == VK_SUCCESS) {
        atomic_store(&lost, false);
#define LOAD_OF_DEVICE(name, can_lose, usual, parameters, arguments)                               \
    next_##name = (PFN_##name)next_device_function(*made, #name);
        DEVICE_FUNCTIONS(LOAD_OF_DEVICE)
#define LOAD_COMMAND(name, parameters, call) LOAD_OF_DEVICE(name, false, 0, (), ())
        FAMILY_COMMANDS(LOAD_COMMAND)
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
#define FIND_COMMAND(function, parameters, call) FIND(function, false, 0, (), ())
    FAMILY_COMMANDS(FIND_COMMAND)
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
#define FIND_FAMILY_QUERY(function, Properties, properties) FIND(function, false, 0, (), ())
    FAMILY_QUERIES(FIND_FAMILY_QUERY)
    FIND(vkGetPhysicalDeviceSurfaceSupportKHR, false, 0, (), ())
    return next_instance_function ? next_instance_function(instance, name) : NULL;
}
