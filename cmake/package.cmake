# Debian packages (target package, ./dev package): orbid, liborbid-dev, and python3-orbid and orbid-mpi where they are built.
if(ORBID_SYNTAX_ONLY)
  return()
endif()
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME orbid)
set(CPACK_PACKAGE_CONTACT "${ORBID_MAINTAINER}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL runtime development)
get_cmake_property(components COMPONENTS)
if(python IN_LIST components)
  list(APPEND CPACK_COMPONENTS_ALL python)
endif()
if(mpi IN_LIST components)
  list(APPEND CPACK_COMPONENTS_ALL mpi)
  set(CPACK_ORBID_PLUGIN lib/orbid/orbid-mpi.so)
endif()
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")
set(about "Trajectories of chaotic systems cannot be fitted directly, for errors grow
exponentially. orbid reduces a record to its unstable periodic orbits, computes
those of the model, and estimates parameters of the model and of the errors,
with intervals and with what the data do not determine.
")

set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME orbid)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION science)
set(CPACK_COMPONENT_RUNTIME_DESCRIPTION "identification of nonlinear dynamical systems from chaotic data
${about}
This package holds the program, the library and example jobs.")
# CPack's own way to dependencies on libraries adds scripts that call ldconfig; those that run after a removal stay behind
# until a purge. So dpkg-shlibdeps is asked when packages are made, and ldconfig is run by a trigger.
set(control ${CMAKE_BINARY_DIR}/control)
file(CONFIGURE OUTPUT ${control}/triggers CONTENT "activate-noawait ldconfig\n")
file(CONFIGURE OUTPUT ${control}/shlibs @ONLY CONTENT
  "liborbid @PROJECT_VERSION_MAJOR@.@PROJECT_VERSION_MINOR@ orbid (>= @PROJECT_VERSION@)\n")
set(CPACK_DEBIAN_RUNTIME_PACKAGE_CONTROL_EXTRA ${control}/triggers ${control}/shlibs)
set(CPACK_ORBID_BUILD ${CMAKE_BINARY_DIR})
set(CPACK_ORBID_LIBRARIES lib/liborbid.so.${PROJECT_VERSION})
foreach(level IN LISTS ORBID_LEVELS)
  list(APPEND CPACK_ORBID_LIBRARIES lib/glibc-hwcaps/${level}/liborbid.so.${PROJECT_VERSION})
endforeach()
set(CPACK_PROJECT_CONFIG_FILE ${CMAKE_SOURCE_DIR}/cmake/package_dependencies.cmake)
# HDF5 and matio are loaded by their names, which no tool finds. Series are stored with the one, the other is for those
# who have files of Matlab.
find_program(ORBID_DPKG_QUERY dpkg-query)
function(package_of LIBRARY PACKAGE)
  if(ORBID_DPKG_QUERY)
    execute_process(COMMAND ${ORBID_DPKG_QUERY} -S */${LIBRARY} OUTPUT_VARIABLE owner ERROR_QUIET)
    if(owner MATCHES "^([^:,\n ]+)")
      set(${PACKAGE} ${CMAKE_MATCH_1} PARENT_SCOPE)
    endif()
  endif()
endfunction()
package_of(${ORBID_HDF5_LIBRARY} CPACK_ORBID_LOADED)
package_of(${ORBID_MATIO_LIBRARY} CPACK_DEBIAN_RUNTIME_PACKAGE_RECOMMENDS)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SUGGESTS "liborbid-dev (= ${PROJECT_VERSION}-1), orbid-mpi (= ${PROJECT_VERSION}-1), g++, librsvg2-bin")

set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME liborbid-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "orbid (= ${PROJECT_VERSION}-1), libeigen3-dev, libxsimd-dev")
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION "identification of nonlinear dynamical systems (C++ headers)
${about}
This package holds the headers, files for CMake and pkg-config, and examples.
With a compiler beside it orbid compiles equations that a job holds.")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-orbid)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
# The module is for the interpreter of one minor version: another would not find it.
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "orbid (= ${PROJECT_VERSION}-1), python3-numpy")
if(python IN_LIST components)
  execute_process(COMMAND ${ORBID_PYTHON_INTERPRETER} -c
    "from sys import version_info as v; print(f'python3 (>= {v[0]}.{v[1]}), python3 (<< {v[0]}.{v[1] + 1})')"
    OUTPUT_VARIABLE versions OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
  string(APPEND CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS ", ${versions}")
endif()
# As Debian's own packages of Python do: compiled when it is installed, so that what Python writes is gone with the package.
file(CONFIGURE OUTPUT ${control}/postinst @ONLY CONTENT "#!/bin/sh
set -e
if [ \"$1\" = configure ] && command -v py3compile >/dev/null; then py3compile -p python3-orbid; fi
")
file(CONFIGURE OUTPUT ${control}/prerm @ONLY CONTENT "#!/bin/sh
set -e
if command -v py3clean >/dev/null; then py3clean -p python3-orbid; fi
")
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA ${control}/postinst ${control}/prerm)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${CMAKE_LIBRARY_OUTPUT_DIRECTORY})
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "identification of nonlinear dynamical systems (Python)
${about}
This package holds the Python module.")

set(CPACK_DEBIAN_MPI_PACKAGE_NAME orbid-mpi)
set(CPACK_DEBIAN_MPI_PACKAGE_SECTION science)
set(CPACK_DEBIAN_MPI_PACKAGE_DEPENDS "orbid (= ${PROJECT_VERSION}-1)")
# Slurm starts programs of MPI, too.
if(mpi IN_LIST components AND MPIEXEC_EXECUTABLE)
  file(REAL_PATH ${MPIEXEC_EXECUTABLE} mpiexec)
  get_filename_component(mpiexec ${mpiexec} NAME)
  package_of(bin/${mpiexec} CPACK_DEBIAN_MPI_PACKAGE_RECOMMENDS)
endif()
set(CPACK_COMPONENT_MPI_DESCRIPTION "identification of nonlinear dynamical systems (clusters)
${about}
This package holds the plug-in by which campaigns run on many machines.")
include(CPack)
