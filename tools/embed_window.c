// A window of GLFW that shows a cloud: two frames in flight, a resizable swapchain, and the point
// under a click. Escape closes it.
//
//   cc tools/embed_window.c $(pkg-config --cflags --libs pointillist vulkan glfw3) -o embed_window
//   ./embed_window scan.laz
#define GLFW_INCLUDE_VULKAN
#include <GLFW/glfw3.h>
#include <pointillist.h>
#include <stdio.h>
#include <stdlib.h>

enum { IN_FLIGHT = 2, MOST_IMAGES = 8 };

#define HANDLE(handle) ((uint64_t)(uintptr_t)(handle))
#define VULKAN(call)                                                                               \
    do {                                                                                           \
        VkResult result = call;                                                                    \
        if (result < 0) fail(#call, "Vulkan failed");                                              \
    } while (0)
#define DRAW(call)                                                                                 \
    do {                                                                                           \
        if (call != POINTILLIST_RESULT_OK) fail(#call, error.message);                             \
    } while (0)

static PointillistError error;
static GLFWwindow *window;
static VkInstance instance;
static VkSurfaceKHR surface;
static VkPhysicalDevice physical;
static VkDevice device;
static VkQueue queue;
static VkCommandPool pool;
static VkCommandBuffer commands[IN_FLIGHT];
static VkFence done[IN_FLIGHT];
static VkSemaphore acquired[IN_FLIGHT], drawn[MOST_IMAGES];
static VkSwapchainKHR swapchain;
static VkExtent2D size;
static VkImage images[MOST_IMAGES];
static VkImageView views[MOST_IMAGES];
static uint32_t image_count;

static void fail(const char *what, const char *why) {
    fprintf(stderr, "%s: %s\n", what, why);
    exit(1);
}

static void make_device(void) {
    VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
                                     .apiVersion = VK_API_VERSION_1_3};
    VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                 .pApplicationInfo = &application};
    info.ppEnabledExtensionNames = glfwGetRequiredInstanceExtensions(&info.enabledExtensionCount);
    VULKAN(vkCreateInstance(&info, NULL, &instance));
    VULKAN(glfwCreateWindowSurface(instance, window, NULL, &surface));
    uint32_t one = 1;
    VULKAN(vkEnumeratePhysicalDevices(instance, &one, &physical));
    if (one == 0) fail("vkEnumeratePhysicalDevices", "no device");
    DRAW(pointillist_check((const void *)vkGetInstanceProcAddr, HANDLE(instance), HANDLE(physical),
                           &error));
    VkPhysicalDeviceVulkan13Features v13 = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES};
    VkPhysicalDeviceVulkan12Features v12 = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES, .pNext = &v13};
    VkPhysicalDeviceFeatures2 features = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2,
                                          .pNext = &v12};
    DRAW(pointillist_enable_features(&features, false, &error));
    float priority = 1;
    VkDeviceQueueCreateInfo queues = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                      .queueCount = 1,
                                      .pQueuePriorities = &priority};
    const char *extension = VK_KHR_SWAPCHAIN_EXTENSION_NAME;
    VkDeviceCreateInfo create = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                 .pNext = &features,
                                 .queueCreateInfoCount = 1,
                                 .pQueueCreateInfos = &queues,
                                 .enabledExtensionCount = 1,
                                 .ppEnabledExtensionNames = &extension};
    VULKAN(vkCreateDevice(physical, &create, NULL, &device));
    vkGetDeviceQueue(device, 0, 0, &queue);
    VkCommandPoolCreateInfo pools = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                     .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT};
    VULKAN(vkCreateCommandPool(device, &pools, NULL, &pool));
    VkCommandBufferAllocateInfo buffers = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                           .commandPool = pool,
                                           .commandBufferCount = IN_FLIGHT};
    VULKAN(vkAllocateCommandBuffers(device, &buffers, commands));
    VkSemaphoreCreateInfo semaphore = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO};
    VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO,
                               .flags = VK_FENCE_CREATE_SIGNALED_BIT};
    for (int i = 0; i < IN_FLIGHT; ++i) {
        VULKAN(vkCreateFence(device, &fence, NULL, &done[i]));
        VULKAN(vkCreateSemaphore(device, &semaphore, NULL, &acquired[i]));
    }
    for (int i = 0; i < MOST_IMAGES; ++i)
        VULKAN(vkCreateSemaphore(device, &semaphore, NULL, &drawn[i]));
}

static void drop_swapchain(void) {
    VULKAN(vkDeviceWaitIdle(device));
    for (uint32_t i = 0; i < image_count; ++i) vkDestroyImageView(device, views[i], NULL);
    vkDestroySwapchainKHR(device, swapchain, NULL);
    swapchain = VK_NULL_HANDLE;
    image_count = 0;
}

static void make_swapchain(void) {
    VkSurfaceCapabilitiesKHR able;
    VULKAN(vkGetPhysicalDeviceSurfaceCapabilitiesKHR(physical, surface, &able));
    size = able.currentExtent;
    if (size.width == 0 || size.height == 0) return;
    VkSwapchainCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_SWAPCHAIN_CREATE_INFO_KHR,
                                     .surface = surface,
                                     .minImageCount = able.minImageCount,
                                     .imageFormat = VK_FORMAT_B8G8R8A8_UNORM,
                                     .imageExtent = size,
                                     .imageArrayLayers = 1,
                                     .imageUsage = VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT,
                                     .preTransform = able.currentTransform,
                                     .compositeAlpha = VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR,
                                     .presentMode = VK_PRESENT_MODE_FIFO_KHR,
                                     .clipped = VK_TRUE};
    VULKAN(vkCreateSwapchainKHR(device, &info, NULL, &swapchain));
    image_count = MOST_IMAGES;
    VULKAN(vkGetSwapchainImagesKHR(device, swapchain, &image_count, images));
    for (uint32_t i = 0; i < image_count; ++i) {
        VkImageViewCreateInfo view = {
            .sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO,
            .image = images[i],
            .viewType = VK_IMAGE_VIEW_TYPE_2D,
            .format = VK_FORMAT_B8G8R8A8_UNORM,
            .subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1}};
        VULKAN(vkCreateImageView(device, &view, NULL, &views[i]));
    }
}

// Records the cloud into an image of the swapchain. Returns whether it is complete.
static bool draw_cloud(PointillistRenderer *renderer, uint64_t number, int slot, uint32_t image) {
    PointillistTarget color = pointillist_target_default();
    color.image = HANDLE(images[image]);
    color.view = HANDLE(views[image]);
    color.format = VK_FORMAT_B8G8R8A8_UNORM;
    color.width = size.width;
    color.height = size.height;
    color.clear = true;
    // The semaphore of the acquired image is waited for at this stage.
    color.before.stages = VK_PIPELINE_STAGE_2_COLOR_ATTACHMENT_OUTPUT_BIT;
    color.after.layout = VK_IMAGE_LAYOUT_PRESENT_SRC_KHR;
    PointillistView view = pointillist_view_default();
    view.width = size.width;
    view.height = size.height;
    // Nothing is framed until a cloud is ready.
    bool framed = pointillist_frame_clouds(renderer, POINTILLIST_PRESET_FIT, 0.01, 1e9, &view,
                                           &error) == POINTILLIST_RESULT_OK;
    PointillistFrame frame = pointillist_frame_default();
    frame.number = number;
    frame.safe = number > IN_FLIGHT ? number - IN_FLIGHT : 0;
    frame.color = &color;
    frame.views = &view;
    frame.view_count = 1;
    PointillistReport report = pointillist_report_default();
    DRAW(pointillist_record(renderer, HANDLE(commands[slot]), &frame, &report, &error));
    return framed && report.settled;
}

// Draws and presents a frame. Returns whether the cloud is complete.
static bool draw(PointillistRenderer *renderer, uint64_t number) {
    int slot = number % IN_FLIGHT;
    VULKAN(vkWaitForFences(device, 1, &done[slot], VK_TRUE, UINT64_MAX));
    uint32_t image;
    VkResult found = vkAcquireNextImageKHR(device, swapchain, UINT64_MAX, acquired[slot],
                                           VK_NULL_HANDLE, &image);
    if (found == VK_ERROR_OUT_OF_DATE_KHR) {
        drop_swapchain();
        make_swapchain();
        return false;
    }
    VULKAN(found);
    VULKAN(vkResetFences(device, 1, &done[slot]));
    VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    VULKAN(vkBeginCommandBuffer(commands[slot], &begin));
    bool complete = draw_cloud(renderer, number, slot, image);
    VULKAN(vkEndCommandBuffer(commands[slot]));
    VkPipelineStageFlags stage = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
    VkSubmitInfo submit = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                           .waitSemaphoreCount = 1,
                           .pWaitSemaphores = &acquired[slot],
                           .pWaitDstStageMask = &stage,
                           .commandBufferCount = 1,
                           .pCommandBuffers = &commands[slot],
                           .signalSemaphoreCount = 1,
                           .pSignalSemaphores = &drawn[image]};
    VULKAN(vkQueueSubmit(queue, 1, &submit, done[slot]));
    VkPresentInfoKHR present = {.sType = VK_STRUCTURE_TYPE_PRESENT_INFO_KHR,
                                .waitSemaphoreCount = 1,
                                .pWaitSemaphores = &drawn[image],
                                .swapchainCount = 1,
                                .pSwapchains = &swapchain,
                                .pImageIndices = &image};
    found = vkQueuePresentKHR(queue, &present);
    if (found != VK_SUCCESS && found != VK_SUBOPTIMAL_KHR && found != VK_ERROR_OUT_OF_DATE_KHR)
        fail("vkQueuePresentKHR", "Vulkan failed");
    return complete;
}

int main(int count, char **arguments) {
    if (count != 2) fail("usage", "embed_window CLOUD");
    if (!glfwInit() || !glfwVulkanSupported()) fail("GLFW", "no display, or no Vulkan");
    glfwWindowHint(GLFW_CLIENT_API, GLFW_NO_API);
    window = glfwCreateWindow(400, 300, "embed", NULL, NULL);
    if (!window) fail("GLFW", "no window");
    // Clicks and keys count, however short.
    glfwSetInputMode(window, GLFW_STICKY_MOUSE_BUTTONS, GLFW_TRUE);
    glfwSetInputMode(window, GLFW_STICKY_KEYS, GLFW_TRUE);
    make_device();
    make_swapchain();
    PointillistHost host = pointillist_host_default();
    host.get_instance_proc_addr = (const void *)vkGetInstanceProcAddr;
    host.instance = HANDLE(instance);
    host.physical_device = HANDLE(physical);
    host.device = HANDLE(device);
    PointillistRenderer *renderer;
    DRAW(pointillist_new(&host, &renderer, &error));
    uint64_t cloud, pick = 0, number = 0;
    const char *files[1] = {arguments[1]};
    DRAW(pointillist_open(renderer, files, 1, NULL, &cloud, &error));
    bool was_complete = false, was_pressed = false;
    while (!glfwWindowShouldClose(window)) {
        glfwPollEvents();
        if (glfwGetKey(window, GLFW_KEY_ESCAPE) == GLFW_PRESS) break;
        bool pressed = glfwGetMouseButton(window, GLFW_MOUSE_BUTTON_LEFT) == GLFW_PRESS;
        double x, y;
        glfwGetCursorPos(window, &x, &y);
        if (pressed && !was_pressed && x >= 0 && y >= 0)
            DRAW(pointillist_pick(renderer, (uint32_t)x, (uint32_t)y, &pick, &error));
        was_pressed = pressed;
        int width, height;
        glfwGetFramebufferSize(window, &width, &height);
        bool resized = (uint32_t)width != size.width || (uint32_t)height != size.height;
        if (resized && swapchain != VK_NULL_HANDLE) drop_swapchain();
        if (swapchain == VK_NULL_HANDLE) make_swapchain();
        if (swapchain == VK_NULL_HANDLE) continue;
        bool complete = draw(renderer, ++number);
        if (complete && (!was_complete || resized))
            printf("complete %u x %u\n", size.width, size.height);
        was_complete = complete;
        PointillistPicked picked = pointillist_picked_default();
        if (pick) DRAW(pointillist_picked(renderer, pick, &picked, &error));
        if (picked.answered) pick = 0;
        if (picked.met)
            printf("picked %g %g %g\n", picked.world[0], picked.world[1], picked.world[2]);
        fflush(stdout);
        PointillistCloudState state;
        DRAW(pointillist_state(renderer, cloud, &state, &error));
        if (state == POINTILLIST_CLOUD_STATE_FAILED) fail(arguments[1], error.message);
    }
    drop_swapchain();
    pointillist_free(renderer);
    for (int i = 0; i < IN_FLIGHT; ++i) {
        vkDestroyFence(device, done[i], NULL);
        vkDestroySemaphore(device, acquired[i], NULL);
    }
    for (int i = 0; i < MOST_IMAGES; ++i) vkDestroySemaphore(device, drawn[i], NULL);
    vkDestroyCommandPool(device, pool, NULL);
    vkDestroyDevice(device, NULL);
    vkDestroySurfaceKHR(instance, surface, NULL);
    vkDestroyInstance(instance, NULL);
    glfwDestroyWindow(window);
    glfwTerminate();
    return 0;
}
