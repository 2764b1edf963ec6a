/* A Vulkan driver that fails on purpose. It hands everything on to Mesa's driver in software, counts submissions, and after
 * FAIL_AFTER of them fails as FAIL_HOW says. Built and used by driver.rs; types are those of the Vulkan specification, and
 * handles are pointers. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { TIMEOUT = 2, OUT_OF_DEVICE_MEMORY = -2, DEVICE_LOST = -4, MEMORY_MAP_FAILED = -5 };
typedef void (*Function)(void);
typedef Function (*Lookup)(void *, const char *);
typedef int (*Submit)(void *, uint32_t, const void *, void *);
typedef int (*WaitForFences)(void *, uint32_t, const void *, uint32_t, uint64_t);
typedef int (*WaitSemaphores)(void *, const void *, uint64_t);
typedef int (*AllocateMemory)(void *, const void *, const void *, void *);
typedef int (*MapMemory)(void *, void *, uint64_t, uint64_t, uint32_t, void **);

static Lookup of_device;
static Submit real_submit, real_submit2;
static WaitForFences real_wait_for_fences;
static WaitSemaphores real_wait_semaphores;
static AllocateMemory real_allocate_memory;
static MapMemory real_map_memory;
static int submissions;

static int fails(const char *how) {
    const char *after = getenv("FAIL_AFTER"), *mode = getenv("FAIL_HOW");
    return mode && !strcmp(mode, how) && submissions >= (after ? atoi(after) : 0);
}

static void *real(const char *name) {
    static void *library;
    if (!library) library = dlopen("libvulkan_lvp.so", RTLD_NOW);
    return library ? dlsym(library, name) : NULL;
}

/* Work that was submitted is never done: a wait without an end takes for ever, and others need not be sat out. */
static int wait_in_vain(uint64_t nanoseconds) {
    if (nanoseconds == UINT64_MAX) pause();
    return TIMEOUT;
}

static int submit(void *queue, uint32_t count, const void *infos, void *fence) {
    if (fails("submit")) return DEVICE_LOST;
    if (fails("time-out")) return 0;
    submissions++;
    return real_submit(queue, count, infos, fence);
}

static int submit2(void *queue, uint32_t count, const void *infos, void *fence) {
    if (fails("submit")) return DEVICE_LOST;
    if (fails("time-out")) return 0;
    submissions++;
    return real_submit2(queue, count, infos, fence);
}

static int wait_for_fences(void *device, uint32_t count, const void *fences, uint32_t all, uint64_t nanoseconds) {
    if (fails("wait")) return DEVICE_LOST;
    if (fails("time-out")) return wait_in_vain(nanoseconds);
    return real_wait_for_fences(device, count, fences, all, nanoseconds);
}

static int wait_semaphores(void *device, const void *info, uint64_t nanoseconds) {
    if (fails("wait")) return DEVICE_LOST;
    if (fails("time-out")) return wait_in_vain(nanoseconds);
    return real_wait_semaphores(device, info, nanoseconds);
}

static int allocate_memory(void *device, const void *info, const void *allocator, void *memory) {
    return fails("memory") ? OUT_OF_DEVICE_MEMORY : real_allocate_memory(device, info, allocator, memory);
}

static int map_memory(void *device, void *memory, uint64_t offset, uint64_t size, uint32_t flags, void **data) {
    return fails("map") ? MEMORY_MAP_FAILED : real_map_memory(device, memory, offset, size, flags, data);
}

/* What stands in for a function. */
static Function instead(const char *name, Function function) {
    struct { const char *name; Function *real, ours; } replaced[] = {
        {"vkQueueSubmit", (Function *)&real_submit, (Function)submit},
        {"vkQueueSubmit2", (Function *)&real_submit2, (Function)submit2},
        {"vkQueueSubmit2KHR", (Function *)&real_submit2, (Function)submit2},
        {"vkWaitForFences", (Function *)&real_wait_for_fences, (Function)wait_for_fences},
        {"vkWaitSemaphores", (Function *)&real_wait_semaphores, (Function)wait_semaphores},
        {"vkWaitSemaphoresKHR", (Function *)&real_wait_semaphores, (Function)wait_semaphores},
        {"vkAllocateMemory", (Function *)&real_allocate_memory, (Function)allocate_memory},
        {"vkMapMemory", (Function *)&real_map_memory, (Function)map_memory},
    };
    for (size_t i = 0; function && i < sizeof replaced / sizeof *replaced; i++)
        if (!strcmp(name, replaced[i].name)) {
            *replaced[i].real = function;
            return replaced[i].ours;
        }
    return function;
}

static Function device_function(void *device, const char *name) {
    if (!strcmp(name, "vkGetDeviceProcAddr")) return (Function)device_function;
    return instead(name, of_device(device, name));
}

/* The three functions that the loader looks for. */
Function vk_icdGetInstanceProcAddr(void *instance, const char *name) {
    Lookup lookup = (Lookup)real("vk_icdGetInstanceProcAddr");
    if (!lookup) return NULL;
    if (!strcmp(name, "vkGetDeviceProcAddr")) {
        of_device = (Lookup)lookup(instance, name);
        return of_device ? (Function)device_function : NULL;
    }
    return instead(name, lookup(instance, name));
}

Function vk_icdGetPhysicalDeviceProcAddr(void *instance, const char *name) {
    Lookup lookup = (Lookup)real("vk_icdGetPhysicalDeviceProcAddr");
    return lookup ? lookup(instance, name) : NULL;
}

int vk_icdNegotiateLoaderICDInterfaceVersion(uint32_t *version) {
    if (fails("crash when listed")) abort();
    if (fails("hang when listed")) pause();
    int (*negotiate)(uint32_t *) = (int (*)(uint32_t *))real("vk_icdNegotiateLoaderICDInterfaceVersion");
    return negotiate ? negotiate(version) : -3;
}
