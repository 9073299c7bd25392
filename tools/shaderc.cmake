# How shaderc is built: with little optimisation, many files at a time, and without what we do not link.
# .cargo/config.toml names this file; CMake reads it as a toolchain first, and once more after shaderc's project().
set(CMAKE_C_FLAGS_RELEASE "-O1" CACHE STRING "")
set(CMAKE_CXX_FLAGS_RELEASE "-O1" CACHE STRING "")
set(SHADERC_SKIP_EXAMPLES ON CACHE BOOL "")
set(SPIRV_SKIP_TESTS ON CACHE BOOL "")
set(SKIP_SPIRV_TOOLS_INSTALL ON CACHE BOOL "")
set(CMAKE_PROJECT_native-shaderc_INCLUDE ${CMAKE_CURRENT_LIST_FILE} CACHE STRING "")

# Leaves a target out if there is one of this name.
function(without)
    foreach(target ${ARGN})
        if(TARGET ${target})
            set_target_properties(${target} PROPERTIES EXCLUDE_FROM_ALL ON)
        endif()
    endforeach()
endfunction()

# Compiles the files of a target together, since their headers take most of the time. Those named are compiled alone:
# they and others define the same names.
function(together target)
    get_target_property(folder ${target} SOURCE_DIR)
    list(TRANSFORM ARGN PREPEND ${folder}/)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 16)
    set_source_files_properties(${ARGN} DIRECTORY ${folder} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
endfunction()

function(at_the_end)
    without(SPIRV-Tools-diff SPIRV-Tools-link SPIRV-Tools-lint SPIRV-Tools-reduce SPIRV-Tools-shared)
    # Files of other versions may define other names twice: they are compiled one by one.
    if(CMAKE_SOURCE_DIR MATCHES "shaderc-sys-0\\.10\\.1/")
        together(glslang ../SPIRV/SpvBuilder.cpp)
        together(SPIRV-Tools-static spirv_reducer_options.cpp val/validate_ray_tracing_reorder.cpp)
        together(SPIRV-Tools-opt basic_block.cpp ir_context.cpp local_single_block_elim_pass.cpp
            local_single_store_elim_pass.cpp mem_pass.cpp reduce_load_size.cpp)
    endif()
endfunction()

if(PROJECT_NAME STREQUAL native-shaderc)
    cmake_language(DEFER DIRECTORY ${CMAKE_SOURCE_DIR} CALL at_the_end)
endif()
