# Flags that our own code is built with; they travel with the targets and touch nothing else.
add_library(orbid_warnings INTERFACE)
target_compile_options(orbid_warnings INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wnon-virtual-dtor -Woverloaded-virtual
  $<$<BOOL:${ORBID_WERROR}>:-Werror>)

# Scalar, dual and pack must agree in the value, so nothing is contracted to fused operations.
add_library(orbid_flags INTERFACE)
target_compile_options(orbid_flags INTERFACE -ffp-contract=off)
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

# Headers that nearly every file includes, parsed once for all rooms and once more for all tests.
function(add_precompiled name)
  add_library(${name} OBJECT ${CMAKE_SOURCE_DIR}/cmake/precompiled.cpp)
  target_link_libraries(${name} PRIVATE orbid_flags orbid_warnings fmt::fmt TBB::tbb nlohmann_json::nlohmann_json ${ARGN})
endfunction()
add_precompiled(orbid_precompiled orbid_library_flags)
target_precompile_headers(orbid_precompiled PRIVATE ${CMAKE_SOURCE_DIR}/cmake/precompiled.hpp)
if(ORBID_TESTS)
  find_package(Catch2 REQUIRED)
  add_precompiled(orbid_precompiled_tests Catch2::Catch2 orbid_test_flags)
  target_precompile_headers(orbid_precompiled_tests PRIVATE
    ${CMAKE_SOURCE_DIR}/cmake/precompiled.hpp ${CMAKE_SOURCE_DIR}/tests/catch.hpp)
endif()

# One room: a static library of listed sources, its headers each compilable alone, and the rooms it may use. Public
# headers, and what they include (in a folder detail/), are installed; others are not.
#   add_module(periodic PUBLIC_HEADERS a.hpp HEADERS b.hpp SOURCES a.cpp b.cpp DEPENDS models PACKAGES fmt::fmt)
function(add_module name)
  cmake_parse_arguments(ARG "" "" "PUBLIC_HEADERS;HEADERS;SOURCES;DEPENDS;PACKAGES;PRIVATE_PACKAGES" ${ARGN})
  add_library(orbid_${name} STATIC ${ARG_SOURCES})
  target_link_libraries(orbid_${name} PRIVATE orbid_warnings orbid_library_flags fmt::fmt ${ARG_PRIVATE_PACKAGES})
  target_precompile_headers(orbid_${name} REUSE_FROM orbid_precompiled)
  target_sources(orbid_${name} PUBLIC
    FILE_SET public TYPE HEADERS BASE_DIRS ${CMAKE_SOURCE_DIR} FILES ${ARG_PUBLIC_HEADERS}
    FILE_SET private TYPE HEADERS BASE_DIRS ${CMAKE_SOURCE_DIR} FILES ${ARG_HEADERS})
  set_target_properties(orbid_${name} PROPERTIES VERIFY_INTERFACE_HEADER_SETS ON)
  list(TRANSFORM ARG_PUBLIC_HEADERS PREPEND ${name}/ OUTPUT_VARIABLE installed)
  set_target_properties(orbid_${name} PROPERTIES ORBID_PUBLIC_HEADERS "${installed}")
  list(TRANSFORM ARG_DEPENDS PREPEND orbid_)
  target_link_libraries(orbid_${name} PUBLIC orbid_flags ${ARG_DEPENDS} ${ARG_PACKAGES})
endfunction()

# The tests of one room: one executable of listed sources, registered under its labels.
#   add_room_tests(periodic SOURCES a_test.cpp DEPENDS periodic)
function(add_room_tests name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS;PACKAGES" ${ARGN})
  list(TRANSFORM ARG_DEPENDS PREPEND orbid_)
  add_executable(${name}_test ${ARG_SOURCES})
  target_link_libraries(${name}_test PRIVATE orbid_test_main orbid_warnings fmt::fmt ${ARG_DEPENDS} ${ARG_PACKAGES})
  target_precompile_headers(${name}_test REUSE_FROM orbid_precompiled_tests)
  target_link_libraries(${name}_test PRIVATE orbid_test_flags)
  # Of templates that tests and the room both instantiate the linker takes the first: the room's optimised ones, if it
  # stands before the tests' objects.
  target_link_options(${name}_test PRIVATE
    "LINKER:--whole-archive,$<TARGET_FILE:orbid_${name}>,--no-whole-archive")
  target_compile_definitions(${name}_test PRIVATE ORBID_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
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
