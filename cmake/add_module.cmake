# Flags that our own code is built with; they travel with the targets and touch nothing else.
add_library(orbid_warnings INTERFACE)
target_compile_options(orbid_warnings INTERFACE
  $<$<CXX_COMPILER_ID:GNU>:-fpch-preprocess> -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wnon-virtual-dtor -Woverloaded-virtual
  $<$<BOOL:${ORBID_WERROR}>:-Werror>)

# Scalar, dual and pack must agree in the value, so nothing is contracted to fused operations.
add_library(orbid_flags INTERFACE)
target_compile_options(orbid_flags INTERFACE -ffp-contract=off)
if(ORBID_SYNTAX_ONLY)
  target_compile_options(orbid_flags INTERFACE $<$<NOT:$<BOOL:$<TARGET_PROPERTY:ORBID_PRECOMPILES>>>:-fsyntax-only>)
endif()
target_include_directories(orbid_flags INTERFACE ${CMAKE_SOURCE_DIR})
if(ORBID_PLAIN_THREADS)
  target_include_directories(orbid_flags BEFORE INTERFACE ${CMAKE_SOURCE_DIR}/tests/threads)
endif()
target_link_libraries(orbid_flags INTERFACE Eigen3::Eigen Threads::Threads)
# BLAS-like threading inside Eigen would make sums depend on the number of threads. How Eigen aligns its types and
# allocates must not depend on -march or sanitizers, which a program that uses the library may choose differently: with
# its own allocator (16 bytes more for each matrix) whoever frees finds the address before the matrix.
target_compile_definitions(orbid_flags INTERFACE EIGEN_DONT_PARALLELIZE
  EIGEN_MAX_ALIGN_BYTES=16 EIGEN_MAX_STATIC_ALIGN_BYTES=16 EIGEN_MALLOC_ALREADY_ALIGNED=0)

# The rooms together are one shared library (cmake/library.cmake): of their symbols only those of installed headers, which
# say so themselves, are seen from outside, and calls within the library stay within it.
add_library(orbid_library_flags INTERFACE)
target_compile_options(orbid_library_flags INTERFACE
  -fPIC -fvisibility=hidden -fvisibility-inlines-hidden -fno-semantic-interposition)

# Tests are compiled far more often than they run: what has to be fast is in the rooms.
add_library(orbid_test_flags INTERFACE)
target_compile_options(orbid_test_flags INTERFACE $<$<NOT:$<CONFIG:Debug>>:-O0>)

# Headers that nearly every file includes, parsed once for all rooms and once more for all tests. They are named relative
# to the root, so that a cache of compilers' results finds them in every clone. Clang, which only reads, also keeps what
# they instantiate; GCC says for the cache what it reads.
function(add_precompiled name)
  cmake_parse_arguments(ARG "" "" "HEADERS;LINK" ${ARGN})
  add_library(${name} OBJECT ${CMAKE_SOURCE_DIR}/cmake/precompiled.cpp)
  target_link_libraries(${name} PRIVATE orbid_flags orbid_warnings fmt::fmt TBB::tbb nlohmann_json::nlohmann_json ${ARG_LINK})
  set_target_properties(${name} PROPERTIES ORBID_PRECOMPILES ON)
  if(ORBID_SYNTAX_ONLY)
    target_compile_options(${name} PRIVATE -fpch-instantiate-templates "SHELL:-Xclang -fno-pch-timestamp")
    foreach(header IN LISTS ARG_HEADERS)
      target_compile_options(${name} PRIVATE "SHELL:-Xclang -include -Xclang ${header}")
    endforeach()
  endif()
  list(TRANSFORM ARG_HEADERS REPLACE "(.+)" "<\\1>")
  target_precompile_headers(${name} PRIVATE ${ARG_HEADERS})
endfunction()
add_precompiled(orbid_precompiled HEADERS cmake/precompiled.hpp LINK orbid_library_flags)
if(ORBID_TESTS)
  find_package(Catch2 REQUIRED)
  add_precompiled(orbid_precompiled_tests
    HEADERS cmake/precompiled.hpp tests/catch.hpp LINK Catch2::Catch2 orbid_test_flags)
endif()

# Sources of a folder in batches, each compiled as one file: what headers instantiate is then instantiated once a batch.
# A batch names its files relative to the root, so that its text, and a cache of compilers' results, is the same in every
# clone. Names of a folder are unique for this. Without ORBID_BATCHES every file is compiled alone.
set(ORBID_BATCH_SIZE 14 CACHE STRING "Files of a batch at most")
function(batch_sources result name)
  set(sources ${ARGN})
  list(LENGTH sources count)
  if(NOT ORBID_BATCHES OR count LESS 2)
    set(${result} ${sources} PARENT_SCOPE)
    return()
  endif()
  math(EXPR batches "(${count} + ${ORBID_BATCH_SIZE} - 1) / ${ORBID_BATCH_SIZE}")
  math(EXPR size "(${count} + ${batches} - 1) / ${batches}")
  set(made "")
  string(REPLACE "/" "_" name "${name}")
  foreach(batch RANGE 1 ${batches})
    math(EXPR begin "(${batch} - 1) * ${size}")
    list(SUBLIST sources ${begin} ${size} members)
    set(text "// Written by the build: a batch of sources, compiled as one.\n")
    foreach(member IN LISTS members)
      file(RELATIVE_PATH path ${CMAKE_SOURCE_DIR} ${member})
      string(APPEND text "#include \"${path}\"\n")
    endforeach()
    set(file ${CMAKE_CURRENT_BINARY_DIR}/${name}_batch_${batch}.cpp)
    file(CONFIGURE OUTPUT ${file} CONTENT "${text}" @ONLY)
    list(APPEND made ${file})
  endforeach()
  set(${result} ${made} PARENT_SCOPE)
endfunction()

# One room: a static library of the sources in its folders, its headers each compilable alone, and the rooms it may use.
# Public headers (files or patterns) are installed; others are not. Sources named ALONE have flags of their own and are
# in no batch. Files named WITHOUT are sources of another target, or headers that need what only this room includes.
#   add_module(periodic FOLDERS orbit search PUBLIC_HEADERS orbit/orbit.hpp DEPENDS models PACKAGES fmt::fmt)
function(add_module name)
  cmake_parse_arguments(ARG "" "" "FOLDERS;PUBLIC_HEADERS;ALONE;WITHOUT;SOURCES;DEPENDS;PACKAGES;PRIVATE_PACKAGES" ${ARGN})
  set(here ${CMAKE_CURRENT_SOURCE_DIR})
  # Clang reads each file of the rooms alone: what a batch lends it would be missing in builds without batches.
  if(ORBID_SYNTAX_ONLY)
    set(ORBID_BATCHES OFF)
  endif()
  set(without ${ARG_WITHOUT})
  list(TRANSFORM ARG_ALONE PREPEND ${here}/)
  list(TRANSFORM ARG_WITHOUT PREPEND ${here}/)
  set(sources ${ARG_ALONE} ${ARG_SOURCES})
  foreach(folder IN LISTS ARG_FOLDERS)
    file(GLOB files CONFIGURE_DEPENDS ${here}/${folder}/*.cpp)
    list(REMOVE_ITEM files ${ARG_ALONE} ${ARG_WITHOUT})
    batch_sources(files ${folder} ${files})
    list(APPEND sources ${files})
  endforeach()
  set(public "")
  set(headers "")
  foreach(header IN LISTS ARG_PUBLIC_HEADERS)
    file(GLOB files RELATIVE ${here} CONFIGURE_DEPENDS ${here}/${header})
    list(APPEND public ${files})
  endforeach()
  foreach(folder IN LISTS ARG_FOLDERS)
    file(GLOB files RELATIVE ${here} CONFIGURE_DEPENDS ${here}/${folder}/*.hpp)
    list(APPEND headers ${files})
  endforeach()
  list(REMOVE_ITEM headers ${public} ${without})
  add_library(orbid_${name} STATIC ${sources})
  target_link_libraries(orbid_${name} PRIVATE orbid_warnings orbid_library_flags fmt::fmt ${ARG_PRIVATE_PACKAGES})
  target_precompile_headers(orbid_${name} REUSE_FROM orbid_precompiled)
  target_sources(orbid_${name} PUBLIC
    FILE_SET public TYPE HEADERS BASE_DIRS ${CMAKE_SOURCE_DIR} FILES ${public}
    FILE_SET private TYPE HEADERS BASE_DIRS ${CMAKE_SOURCE_DIR} FILES ${headers})
  set_target_properties(orbid_${name} PROPERTIES VERIFY_INTERFACE_HEADER_SETS ON)
  list(TRANSFORM public PREPEND ${name}/)
  set_target_properties(orbid_${name} PROPERTIES ORBID_PUBLIC_HEADERS "${public}")
  list(TRANSFORM ARG_DEPENDS PREPEND orbid_)
  target_link_libraries(orbid_${name} PUBLIC orbid_flags ${ARG_DEPENDS} ${ARG_PACKAGES})
endfunction()

# The tests of one room: one executable of the sources in its folders, registered under its labels. Sources named ALONE
# have flags of their own and are in no batch.
#   add_room_tests(periodic FOLDERS orbit search DEPENDS periodic)
function(add_room_tests name)
  cmake_parse_arguments(ARG "" "" "FOLDERS;ALONE;DEPENDS;PACKAGES" ${ARGN})
  set(here ${CMAKE_CURRENT_SOURCE_DIR})
  list(TRANSFORM ARG_ALONE PREPEND ${here}/)
  set(sources ${ARG_ALONE})
  foreach(folder IN LISTS ARG_FOLDERS)
    file(GLOB files CONFIGURE_DEPENDS ${here}/${folder}/*.cpp)
    list(REMOVE_ITEM files ${ARG_ALONE})
    batch_sources(files ${folder} ${files})
    list(APPEND sources ${files})
  endforeach()
  list(TRANSFORM ARG_DEPENDS PREPEND orbid_)
  add_executable(${name}_test ${sources})
  target_link_libraries(${name}_test PRIVATE orbid_test_main orbid_warnings fmt::fmt ${ARG_DEPENDS} ${ARG_PACKAGES})
  target_precompile_headers(${name}_test REUSE_FROM orbid_precompiled_tests)
  target_link_libraries(${name}_test PRIVATE orbid_test_flags)
  # Of templates that tests and the room both instantiate the linker takes the first: the room's optimised ones, if it
  # stands before the tests' objects.
  target_link_options(${name}_test PRIVATE
    "LINKER:--whole-archive,$<TARGET_FILE:orbid_${name}>,--no-whole-archive")
  add_test(NAME ${name} COMMAND ${name}_test)
  set_tests_properties(${name} PROPERTIES LABELS fast)
endfunction()

# GCC 12 takes what its own header of AVX-512 leaves undefined on purpose for a mistake of who includes it.
set(ORBID_AVX512 "")
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
  set(ORBID_AVX512 -Wno-uninitialized -Wno-maybe-uninitialized)
endif()
include(CheckCXXSourceCompiles)
set(CMAKE_REQUIRED_FLAGS "${CMAKE_CXX_FLAGS}")
if(ORBID_MACHINE)
  string(APPEND CMAKE_REQUIRED_FLAGS " -march=${ORBID_MACHINE}")
endif()
# The answer is cached, so under the name of the machine that was asked for.
string(MAKE_C_IDENTIFIER "ORBID_AVX512_OF_${ORBID_MACHINE}" answer)
check_cxx_source_compiles("#ifndef __AVX512F__\n#error none\n#endif\nint main() {}" ${answer})
set(ORBID_MACHINE_HAS_AVX512 "${${answer}}")
unset(CMAKE_REQUIRED_FLAGS)

# Sources of a room that are compiled for a processor, by -march: ORBID_MACHINE, and once more for each of ORBID_LEVELS,
# which cmake/library.cmake makes further libraries of. They hold no type of Eigen: of its inlined functions, compiled for a
# higher level, the linker could take one for any caller.
#   compile_for_machine(orbits box_tree.cpp)
function(compile_for_machine room)
  set(machine "$<TARGET_PROPERTY:ORBID_MACHINE>")
  set(same "$<STREQUAL:${machine},${ORBID_MACHINE}>")
  set(wide "$<OR:$<STREQUAL:${machine},x86-64-v4>,$<AND:$<BOOL:${ORBID_MACHINE_HAS_AVX512}>,${same}>>")
  set_source_files_properties(${ARGN} PROPERTIES
    SKIP_PRECOMPILE_HEADERS ON
    COMPILE_OPTIONS "$<$<CONFIG:Release>:-O3>;$<$<BOOL:${machine}>:-march=${machine}>;$<${wide}:${ORBID_AVX512}>")
  set_target_properties(orbid_${room} PROPERTIES ORBID_MACHINE "${ORBID_MACHINE}" ORBID_MACHINE_SOURCES "${ARGN}")
  foreach(level IN LISTS ORBID_LEVELS)
    add_library(orbid_${room}_${level} OBJECT ${ARGN})
    target_link_libraries(orbid_${room}_${level} PRIVATE orbid_${room} orbid_warnings orbid_library_flags fmt::fmt)
    set_target_properties(orbid_${room}_${level} PROPERTIES ORBID_MACHINE ${level})
  endforeach()
endfunction()
