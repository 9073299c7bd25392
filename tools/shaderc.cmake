# How shaderc is built: with little optimisation, with precompiled headers, and without what we do not link.
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

# Compiles headers that nearly all files of a target include once, if they are there.
function(precompiled target)
    foreach(header ${ARGN})
        if(TARGET ${target} AND EXISTS ${CMAKE_SOURCE_DIR}/${header})
            target_precompile_headers(${target} PRIVATE ${CMAKE_SOURCE_DIR}/${header})
        endif()
    endforeach()
endfunction()

function(at_the_end)
    without(SPIRV-Tools-diff SPIRV-Tools-link SPIRV-Tools-lint SPIRV-Tools-reduce SPIRV-Tools-shared)
    precompiled(SPIRV-Tools-opt spirv-tools/source/opt/ir_context.h spirv-tools/source/opt/pass.h)
    precompiled(SPIRV-Tools-static spirv-tools/source/val/validation_state.h spirv-tools/source/val/validate.h)
    precompiled(glslang glslang/glslang/MachineIndependent/localintermediate.h)
endfunction()

if(PROJECT_NAME STREQUAL native-shaderc)
    cmake_language(DEFER DIRECTORY ${CMAKE_SOURCE_DIR} CALL at_the_end)
endif()
