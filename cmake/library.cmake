# The rooms as one shared library, liborbid, and what is installed for who links it: public headers, the CMake package,
# pkg-config. For each of ORBID_LEVELS the library is there once more: the loader takes the one from the folder
# glibc-hwcaps/LEVEL beside it on processors that have these instructions (glibc 2.33 and later; ld.so(8)).
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(rooms models estimator periodic orbits identification apps)

# A library of all rooms' objects; of those that are compiled for a processor, those of a level.
function(add_rooms_library target level)
  add_library(${target} SHARED)
  foreach(room IN LISTS rooms)
    set(objects $<TARGET_OBJECTS:orbid_${room}>)
    get_target_property(sources orbid_${room} ORBID_MACHINE_SOURCES)
    if(level AND sources)
      list(TRANSFORM sources REPLACE "^.*/|[.]cpp$" "")
      list(JOIN sources "|" names)
      set(objects $<FILTER:${objects},EXCLUDE,/\(${names}\)[.]cpp> $<TARGET_OBJECTS:orbid_${room}_${level}>)
    endif()
    target_sources(${target} PRIVATE ${objects})
  endforeach()
  # Before 1.0 a minor version may change the binary interface: it is part of the library's name.
  set_target_properties(${target} PROPERTIES
    OUTPUT_NAME orbid EXPORT_NAME orbid LINKER_LANGUAGE CXX
    VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
  target_link_libraries(${target} PRIVATE
    fmt::fmt TBB::tbb Boost::program_options OpenSSL::Crypto SQLite::SQLite3 ZLIB::ZLIB ${CMAKE_DL_LIBS}
    orbid_warnings)
  target_link_options(${target} PRIVATE LINKER:--no-undefined LINKER:--as-needed)
endfunction()

add_rooms_library(orbid_library "")
add_library(orbid::orbid ALIAS orbid_library)
foreach(room IN LISTS rooms)
  get_target_property(headers orbid_${room} ORBID_PUBLIC_HEADERS)
  target_sources(orbid_library PUBLIC
    FILE_SET ${room} TYPE HEADERS BASE_DIRS ${CMAKE_SOURCE_DIR} FILES ${headers})
  list(APPEND file_sets FILE_SET ${room} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/orbid COMPONENT development)
endforeach()
target_link_libraries(orbid_library PUBLIC Eigen3::Eigen)
target_compile_features(orbid_library PUBLIC cxx_std_20)
# Who uses the library aligns and allocates Eigen's types as it does (cmake/add_module.cmake), and scalar, dual and pack of
# an own model must agree.
target_compile_definitions(orbid_library PUBLIC
  EIGEN_MAX_ALIGN_BYTES=16 EIGEN_MAX_STATIC_ALIGN_BYTES=16 EIGEN_MALLOC_ALREADY_ALIGNED=0)
target_compile_options(orbid_library INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-ffp-contract=off>)

if(ORBID_SYNTAX_ONLY)
  return()
endif()
install(TARGETS orbid_library EXPORT orbid
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT runtime NAMELINK_COMPONENT development
  ${file_sets})
foreach(level IN LISTS ORBID_LEVELS)
  add_rooms_library(orbid_library_${level} ${level})
  set_target_properties(orbid_library_${level} PROPERTIES
    LIBRARY_OUTPUT_DIRECTORY ${CMAKE_LIBRARY_OUTPUT_DIRECTORY}/glibc-hwcaps/${level})
  install(TARGETS orbid_library_${level}
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/glibc-hwcaps/${level} COMPONENT runtime NAMELINK_SKIP)
endforeach()

# Compiled models (apps/job/model_plugin.cpp) take these in as they are.
install(FILES models/definition/parameter.cpp models/definition/input_evaluation.cpp
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/orbid/models/definition COMPONENT development)
set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/orbid)
install(EXPORT orbid NAMESPACE orbid:: FILE orbid-targets.cmake DESTINATION ${package_folder} COMPONENT development)
configure_package_config_file(packaging/orbid-config.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/orbid-config.cmake
  INSTALL_DESTINATION ${package_folder})
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/orbid-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/orbid-config.cmake ${CMAKE_CURRENT_BINARY_DIR}/orbid-config-version.cmake
  DESTINATION ${package_folder} COMPONENT development)
# A prefix that moves with the file, however deep its folder is.
file(RELATIVE_PATH ORBID_PREFIX_OF_PC /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
string(REGEX REPLACE "/$" "" ORBID_PREFIX_OF_PC "${ORBID_PREFIX_OF_PC}")
configure_file(packaging/orbid.pc.in ${CMAKE_CURRENT_BINARY_DIR}/orbid.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/orbid.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)
