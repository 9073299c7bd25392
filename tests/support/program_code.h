// Tells calls of the program itself from those of its libraries, for allocators that are preloaded.

#pragma once

#ifndef _GNU_SOURCE
#error "define _GNU_SOURCE first"
#endif
#include <link.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Code of the program; empty until it is found.
static uintptr_t program_begin, program_end;

static int take_first_object(struct dl_phdr_info *object, size_t size, void *unused) {
    (void)size, (void)unused;
    for (int i = 0; i < object->dlpi_phnum; ++i) {
        const ElfW(Phdr) *part = &object->dlpi_phdr[i];
        if (part->p_type == PT_LOAD && part->p_flags & PF_X) {
            program_begin = object->dlpi_addr + part->p_vaddr;
            program_end = program_begin + part->p_memsz;
        }
    }
    // The program is the first of all objects.
    return 1;
}

static void find_program(void) { dl_iterate_phdr(take_first_object, NULL); }

// Tests whether a return address is in the program.
static bool is_of_program(const void *caller) {
    const uintptr_t from = (uintptr_t)caller;
    return from >= program_begin && from < program_end;
}
