// An allocator that counts the bytes that are allocated at the moment, for tools/soak (LD_PRELOAD).
//
// In: the environment.
//   LIVE_BYTES=FILE   two numbers of 8 bytes: what the program itself has allocated, and what its
//                     libraries have, the Vulkan driver above all
//
// An array of the program ends with a tag, by which it is known when it is freed.

#define _GNU_SOURCE
#include "../tests/support/program_code.h"
#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

void *__libc_malloc(size_t bytes);
void *__libc_calloc(size_t count, size_t bytes);
void *__libc_realloc(void *old, size_t bytes);
void *__libc_memalign(size_t align, size_t bytes);
void __libc_free(void *old);

enum owner { PROGRAM, LIBRARIES };

struct live {
    atomic_llong bytes[2];
};
// What is allocated before the file is open is counted here.
static struct live early;
static struct live *_Atomic live = &early;

__attribute__((constructor)) static void begin(void) {
    const char *path = getenv("LIVE_BYTES");
    int file = path ? open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600) : -1;
    if (file < 0 || ftruncate(file, sizeof early) != 0)
        return;
    struct live *shared = mmap(NULL, sizeof early, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (shared == MAP_FAILED)
        return;
    // Programs that this one starts are not counted.
    unsetenv("LIVE_BYTES");
    find_program();
    for (int owner = 0; owner < 2; ++owner)
        atomic_store(&shared->bytes[owner], atomic_load(&early.bytes[owner]));
    atomic_store(&live, shared);
}

static enum owner owner_of(void *caller) {
    return is_of_program(caller) ? PROGRAM : LIBRARIES;
}

// Returns where the tag of an array is.
static uint64_t *tag_of(void *array) {
    return (uint64_t *)((char *)array + (malloc_usable_size(array) & ~(size_t)7) - 8);
}

static uint64_t tag_for(void *array) { return (uint64_t)(uintptr_t)array ^ 0x706f696e74696c6cu; }

static void count(void *array, enum owner owner, int sign) {
    atomic_fetch_add_explicit(&atomic_load(&live)->bytes[owner],
                              sign * (long long)malloc_usable_size(array), memory_order_relaxed);
}

// Counts a new array.
static void *add(void *array, enum owner owner) {
    if (!array)
        return NULL;
    if (owner == PROGRAM)
        *tag_of(array) = tag_for(array);
    count(array, owner, 1);
    return array;
}

// Counts an array that goes, and removes its tag. Returns whose it was.
static enum owner subtract(void *array) {
    uint64_t *tag = tag_of(array);
    enum owner owner = *tag == tag_for(array) ? PROGRAM : LIBRARIES;
    if (owner == PROGRAM)
        *tag = 0;
    count(array, owner, -1);
    return owner;
}

// Returns a size with room for the tag; as it is if that is too large.
static size_t with_tag(size_t bytes, enum owner owner) {
    return owner == PROGRAM && bytes <= SIZE_MAX - 16 ? bytes + 16 : bytes;
}

void *malloc(size_t bytes) {
    enum owner owner = owner_of(__builtin_return_address(0));
    return add(__libc_malloc(with_tag(bytes, owner)), owner);
}

void *calloc(size_t number, size_t bytes) {
    enum owner owner = owner_of(__builtin_return_address(0));
    size_t all;
    if (__builtin_mul_overflow(number, bytes, &all)) {
        errno = ENOMEM;
        return NULL;
    }
    return add(__libc_calloc(1, with_tag(all, owner)), owner);
}

void *realloc(void *old, size_t bytes) {
    enum owner owner = old ? subtract(old) : owner_of(__builtin_return_address(0));
    void *array = __libc_realloc(old, with_tag(bytes, owner));
    // One that cannot grow stays as it was; one of no bytes is freed.
    if (!array && old && with_tag(bytes, owner))
        add(old, owner);
    return add(array, owner);
}

static void *aligned(size_t align, size_t bytes, enum owner owner) {
    return add(__libc_memalign(align, with_tag(bytes, owner)), owner);
}

void *memalign(size_t align, size_t bytes) {
    return aligned(align, bytes, owner_of(__builtin_return_address(0)));
}

void *aligned_alloc(size_t align, size_t bytes) {
    return aligned(align, bytes, owner_of(__builtin_return_address(0)));
}

int posix_memalign(void **array, size_t align, size_t bytes) {
    void *made = aligned(align, bytes, owner_of(__builtin_return_address(0)));
    if (!made)
        return ENOMEM;
    *array = made;
    return 0;
}

void free(void *old) {
    if (!old)
        return;
    subtract(old);
    __libc_free(old);
}
