// A host in C: an offscreen Vulkan program that draws a rectangle through a cloud, in two
// viewports, and picks a point.
//
//   tools/install ~/.local
//   cc tools/embed.c $(pkg-config --cflags --libs pointillist vulkan) -o embed
//   ./embed scan.laz picture.ppm
//
// Everything but draw_cloud is what any Vulkan program has.
#include <pointillist.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <vulkan/vulkan.h>

enum { WIDTH = 800, HEIGHT = 400 };

#define HANDLE(handle) ((uint64_t)(uintptr_t)(handle))
#define VULKAN(call)                                                                               \
    do {                                                                                           \
        VkResult result = call;                                                                    \
        if (result != VK_SUCCESS) fail(#call, "Vulkan failed");                                    \
    } while (0)
#define DRAW(call)                                                                                 \
    do {                                                                                           \
        if (call != POINTILLIST_RESULT_OK) fail(#call, error.message);                             \
    } while (0)

typedef struct {
    VkImage image;
    VkImageView view;
    VkDeviceMemory memory;
    VkFormat format;
    VkImageAspectFlags aspect;
} Image;

static PointillistError error;
static VkInstance instance;
static VkPhysicalDevice physical;
static VkDevice device;
static VkQueue queue;
static VkCommandPool pool;
static VkCommandBuffer commands;
static Image color, depth;
static VkBuffer buffer;
static VkDeviceMemory memory;

static void fail(const char *what, const char *why) {
    fprintf(stderr, "%s: %s\n", what, why);
    exit(1);
}

static VkDeviceMemory allocate(VkMemoryRequirements needs, VkMemoryPropertyFlags flags) {
    VkPhysicalDeviceMemoryProperties kinds;
    vkGetPhysicalDeviceMemoryProperties(physical, &kinds);
    for (uint32_t kind = 0; kind < kinds.memoryTypeCount; ++kind) {
        bool has = (kinds.memoryTypes[kind].propertyFlags & flags) == flags;
        if (!has || !(needs.memoryTypeBits >> kind & 1)) continue;
        VkMemoryAllocateInfo info = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                     .allocationSize = needs.size,
                                     .memoryTypeIndex = kind};
        VkDeviceMemory allocated;
        VULKAN(vkAllocateMemory(device, &info, NULL, &allocated));
        return allocated;
    }
    fail("memory", "none of this kind");
    return VK_NULL_HANDLE;
}

static Image make_image(VkFormat format, VkImageUsageFlags usage, VkImageAspectFlags aspect) {
    Image made = {.format = format, .aspect = aspect};
    VkImageCreateInfo info = {.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO,
                              .imageType = VK_IMAGE_TYPE_2D,
                              .format = format,
                              .extent = {WIDTH, HEIGHT, 1},
                              .mipLevels = 1,
                              .arrayLayers = 1,
                              .samples = VK_SAMPLE_COUNT_1_BIT,
                              .usage = usage};
    VULKAN(vkCreateImage(device, &info, NULL, &made.image));
    VkMemoryRequirements needs;
    vkGetImageMemoryRequirements(device, made.image, &needs);
    made.memory = allocate(needs, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
    VULKAN(vkBindImageMemory(device, made.image, made.memory, 0));
    VkImageViewCreateInfo view = {.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO,
                                  .image = made.image,
                                  .viewType = VK_IMAGE_VIEW_TYPE_2D,
                                  .format = format,
                                  .subresourceRange = {aspect, 0, 1, 0, 1}};
    VULKAN(vkCreateImageView(device, &view, NULL, &made.view));
    return made;
}

static void make_device(void) {
    VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
                                     .apiVersion = VK_API_VERSION_1_3};
    VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                 .pApplicationInfo = &application};
    VULKAN(vkCreateInstance(&info, NULL, &instance));
    uint32_t one = 1;
    VkResult found = vkEnumeratePhysicalDevices(instance, &one, &physical);
    if (found < 0 || one == 0) fail("vkEnumeratePhysicalDevices", "no device");
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
    VkDeviceCreateInfo create = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                 .pNext = &features,
                                 .queueCreateInfoCount = 1,
                                 .pQueueCreateInfos = &queues};
    VULKAN(vkCreateDevice(physical, &create, NULL, &device));
    vkGetDeviceQueue(device, 0, 0, &queue);
    VkCommandPoolCreateInfo pools = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                     .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT};
    VULKAN(vkCreateCommandPool(device, &pools, NULL, &pool));
    VkCommandBufferAllocateInfo buffers = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                           .commandPool = pool,
                                           .commandBufferCount = 1};
    VULKAN(vkAllocateCommandBuffers(device, &buffers, &commands));
    color = make_image(VK_FORMAT_R8G8B8A8_UNORM,
                       VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT,
                       VK_IMAGE_ASPECT_COLOR_BIT);
    depth = make_image(VK_FORMAT_D32_SFLOAT, VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT,
                       VK_IMAGE_ASPECT_DEPTH_BIT);
    VkBufferCreateInfo size = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                               .size = 4 * WIDTH * HEIGHT,
                               .usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT};
    VULKAN(vkCreateBuffer(device, &size, NULL, &buffer));
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(device, buffer, &needs);
    memory = allocate(needs,
                      VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
    VULKAN(vkBindBufferMemory(device, buffer, memory, 0));
}

// Draws a rectangle of one depth in the middle of each half.
static void draw_rectangle(void) {
    VkImageMemoryBarrier2 barriers[2];
    Image *images[2] = {&color, &depth};
    for (int i = 0; i < 2; ++i) {
        barriers[i] = (VkImageMemoryBarrier2){
            .sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER_2,
            .srcStageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
            .dstStageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
            .dstAccessMask = VK_ACCESS_2_MEMORY_READ_BIT | VK_ACCESS_2_MEMORY_WRITE_BIT,
            .newLayout = VK_IMAGE_LAYOUT_ATTACHMENT_OPTIMAL,
            .srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
            .dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
            .image = images[i]->image,
            .subresourceRange = {images[i]->aspect, 0, 1, 0, 1}};
    }
    VkDependencyInfo dependency = {.sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO,
                                   .imageMemoryBarrierCount = 2,
                                   .pImageMemoryBarriers = barriers};
    vkCmdPipelineBarrier2(commands, &dependency);
    VkRenderingAttachmentInfo attachments[2];
    for (int i = 0; i < 2; ++i) {
        attachments[i] =
            (VkRenderingAttachmentInfo){.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO,
                                        .imageView = images[i]->view,
                                        .imageLayout = VK_IMAGE_LAYOUT_ATTACHMENT_OPTIMAL,
                                        .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                        .storeOp = VK_ATTACHMENT_STORE_OP_STORE};
    }
    attachments[0].clearValue.color = (VkClearColorValue){.float32 = {0.2f, 0.2f, 0.25f, 1}};
    VkRenderingInfo rendering = {.sType = VK_STRUCTURE_TYPE_RENDERING_INFO,
                                 .renderArea = {{0, 0}, {WIDTH, HEIGHT}},
                                 .layerCount = 1,
                                 .colorAttachmentCount = 1,
                                 .pColorAttachments = &attachments[0],
                                 .pDepthAttachment = &attachments[1]};
    vkCmdBeginRendering(commands, &rendering);
    VkClearAttachment drawn[2] = {
        {.aspectMask = VK_IMAGE_ASPECT_COLOR_BIT,
         .clearValue.color.float32 = {0.9f, 0.5f, 0.1f, 1}},
        {.aspectMask = VK_IMAGE_ASPECT_DEPTH_BIT, .clearValue.depthStencil.depth = 0.01f / 4.4f}};
    for (int side = 0; side < 2; ++side) {
        VkClearRect rect = {{{side * WIDTH / 2 + 150, 40}, {100, HEIGHT - 80}}, 0, 1};
        vkCmdClearAttachments(commands, 2, drawn, 1, &rect);
    }
    vkCmdEndRendering(commands);
}

static PointillistTarget target_of(const Image *image, VkImageLayout after) {
    PointillistTarget target = pointillist_target_default();
    target.image = HANDLE(image->image);
    target.view = HANDLE(image->view);
    target.format = image->format;
    target.width = WIDTH;
    target.height = HEIGHT;
    target.before = (PointillistAccess){
        .layout = VK_IMAGE_LAYOUT_ATTACHMENT_OPTIMAL,
        .family = UINT32_MAX,
        .stages = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
        .access = VK_ACCESS_2_MEMORY_READ_BIT | VK_ACCESS_2_MEMORY_WRITE_BIT};
    target.after = target.before;
    target.after.layout = after;
    return target;
}

// Records the cloud, once it is loaded, over the rectangle. Returns whether it is complete.
static bool draw_cloud(PointillistRenderer *renderer, uint64_t number) {
    PointillistTarget to_color = target_of(&color, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL);
    PointillistTarget to_depth = target_of(&depth, VK_IMAGE_LAYOUT_ATTACHMENT_OPTIMAL);
    PointillistView views[2] = {pointillist_view_default(), pointillist_view_default()};
    PointillistFrame frame = pointillist_frame_default();
    for (int side = 0; side < 2; ++side) {
        views[side].x = side * WIDTH / 2;
        views[side].width = WIDTH / 2;
        views[side].height = HEIGHT;
        PointillistPreset preset = side ? POINTILLIST_PRESET_FRONT : POINTILLIST_PRESET_FIT;
        PointillistResult framed =
            pointillist_frame_clouds(renderer, preset, 0.01, 1e6, &views[side], &error);
        if (framed == POINTILLIST_RESULT_OK) frame.view_count = side + 1;
    }
    frame.number = number;
    frame.safe = number - 1;
    frame.color = &to_color;
    frame.depth = &to_depth;
    frame.views = views;
    PointillistReport report = pointillist_report_default();
    DRAW(pointillist_record(renderer, HANDLE(commands), &frame, &report, &error));
    return report.settled && report.points > 0;
}

static void submit(void) {
    VkBufferImageCopy region = {.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1},
                                .imageExtent = {WIDTH, HEIGHT, 1}};
    vkCmdCopyImageToBuffer(commands, color.image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, buffer, 1,
                           &region);
    VULKAN(vkEndCommandBuffer(commands));
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                         .commandBufferCount = 1,
                         .pCommandBuffers = &commands};
    VULKAN(vkQueueSubmit(queue, 1, &info, VK_NULL_HANDLE));
    VULKAN(vkQueueWaitIdle(queue));
}

static void write_picture(const char *path) {
    void *pixels;
    VULKAN(vkMapMemory(device, memory, 0, VK_WHOLE_SIZE, 0, &pixels));
    FILE *file = fopen(path, "wb");
    if (!file) fail(path, "cannot be written");
    fprintf(file, "P6 %d %d 255\n", WIDTH, HEIGHT);
    for (int i = 0; i < WIDTH * HEIGHT; ++i) fwrite((char *)pixels + 4 * i, 1, 3, file);
    fclose(file);
    vkUnmapMemory(device, memory);
}

int main(int count, char **arguments) {
    if (count != 3) fail("usage", "embed CLOUD PICTURE.ppm");
    if (pointillist_version() != POINTILLIST_VERSION) fail("pointillist", "another version");
    make_device();
    PointillistHost host = pointillist_host_default();
    host.get_instance_proc_addr = (const void *)vkGetInstanceProcAddr;
    host.instance = HANDLE(instance);
    host.physical_device = HANDLE(physical);
    host.device = HANDLE(device);
    PointillistRenderer *renderer;
    DRAW(pointillist_new(&host, &renderer, &error));
    uint64_t cloud, pick = 0;
    const char *files[1] = {arguments[1]};
    DRAW(pointillist_open(renderer, files, 1, NULL, &cloud, &error));
    PointillistPicked picked = pointillist_picked_default();
    for (uint64_t number = 1; !picked.answered; ++number) {
        VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
        VULKAN(vkBeginCommandBuffer(commands, &begin));
        draw_rectangle();
        bool complete = draw_cloud(renderer, number);
        submit();
        PointillistCloudState state;
        DRAW(pointillist_state(renderer, cloud, &state, &error));
        if (state == POINTILLIST_CLOUD_STATE_FAILED) fail(arguments[1], error.message);
        if (pick) DRAW(pointillist_picked(renderer, pick, &picked, &error));
        if (complete && !pick) DRAW(pointillist_pick(renderer, 200, 300, &pick, &error));
    }
    if (picked.met) printf("picked %g %g %g\n", picked.world[0], picked.world[1], picked.world[2]);
    write_picture(arguments[2]);
    pointillist_free(renderer);
    vkDestroyBuffer(device, buffer, NULL);
    vkFreeMemory(device, memory, NULL);
    Image *images[2] = {&color, &depth};
    for (int i = 0; i < 2; ++i) {
        vkDestroyImageView(device, images[i]->view, NULL);
        vkDestroyImage(device, images[i]->image, NULL);
        vkFreeMemory(device, images[i]->memory, NULL);
    }
    vkDestroyCommandPool(device, pool, NULL);
    vkDestroyDevice(device, NULL);
    vkDestroyInstance(instance, NULL);
    return 0;
}
