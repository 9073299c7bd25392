// An allocator that lets one allocation fail, for tests of the program (LD_PRELOAD).
//
// In: the environment.
//   FAULT_AT=N        the N-th allocation of at least FAULT_BYTES fails, counted from 1 over all
//                     threads
//   FAULT_BYTES=N     least bytes of those that count
//   FAULT_LOG=FILE    the number of those that were counted is written there at the end
// Only allocations of the program itself count: those of drivers and other libraries do not.

#define _GNU_SOURCE
#include <errno.h>
#include <link.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

void *__libc_malloc(size_t bytes);
void *__libc_calloc(size_t count, size_t bytes);
void *__libc_realloc(void *old, size_t bytes);
void *__libc_memalign(size_t align, size_t bytes);

static atomic_long calls;
static long at = -1;
static size_t least = SIZE_MAX;
// Code of the program.
static uintptr_t first, end;

static int find_program(struct dl_phdr_info *object, size_t size, void *unused) {
    (void)size, (void)unused;
    for (int i = 0; i < object->dlpi_phnum; ++i) {
        const ElfW(Phdr) *part = &object->dlpi_phdr[i];
        if (part->p_type == PT_LOAD && part->p_flags & PF_X) {
            first = object->dlpi_addr + part->p_vaddr;
            end = first + part->p_memsz;
        }
    }
    // The program is the first of all objects.
    return 1;
}

__attribute__((constructor)) static void begin(void) {
    const char *number = getenv("FAULT_AT");
    const char *bytes = getenv("FAULT_BYTES");
    dl_iterate_phdr(find_program, NULL);
    at = number ? atol(number) : -1;
    least = bytes ? strtoull(bytes, NULL, 10) : SIZE_MAX;
}

__attribute__((destructor)) static void finish(void) {
    const char *path = getenv("FAULT_LOG");
    FILE *log = path ? fopen(path, "w") : NULL;
    if (log) {
        fprintf(log, "%ld\n", atomic_load(&calls));
        fclose(log);
    }
}

static bool fails(size_t bytes, void *caller) {
    const uintptr_t from = (uintptr_t)caller;
    return bytes >= least && from >= first && from < end && atomic_fetch_add(&calls, 1) + 1 == at;
}

#define FAILS(bytes) fails(bytes, __builtin_return_address(0))

void *malloc(size_t bytes) {
    return FAILS(bytes) ? (errno = ENOMEM, NULL) : __libc_malloc(bytes);
}

void *calloc(size_t count, size_t bytes) {
    return FAILS(count * bytes) ? (errno = ENOMEM, NULL) : __libc_calloc(count, bytes);
}

void *realloc(void *old, size_t bytes) {
    return FAILS(bytes) ? (errno = ENOMEM, NULL) : __libc_realloc(old, bytes);
}

void *aligned_alloc(size_t align, size_t bytes) {
    return FAILS(bytes) ? (errno = ENOMEM, NULL) : __libc_memalign(align, bytes);
}

int posix_memalign(void **made, size_t align, size_t bytes) {
    if (FAILS(bytes)) {
        return ENOMEM;
    }
    *made = __libc_memalign(align, bytes);
    return *made ? 0 : ENOMEM;
}
