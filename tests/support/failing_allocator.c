// An allocator that lets one allocation fail, for tests of the program (LD_PRELOAD).
//
// In: the environment.
//   FAULT_AT=N        the N-th allocation of at least FAULT_BYTES fails, counted from 1 over all
//                     threads
//   FAULT_BYTES=N     least bytes of those that count
//   FAULT_LOG=FILE    the number of those that were counted is written there at the end
// Only allocations of the program itself count: those of drivers and other libraries do not.

#define _GNU_SOURCE
#include "program_code.h"
#include <errno.h>
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

__attribute__((constructor)) static void begin(void) {
    const char *number = getenv("FAULT_AT");
    const char *bytes = getenv("FAULT_BYTES");
    find_program();
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
    return bytes >= least && is_of_program(caller) && atomic_fetch_add(&calls, 1) + 1 == at;
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
