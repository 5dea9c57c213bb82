# Run by CPack for each of its generators: the packages that the program, its libraries and the plug-in for MPI need, as
# dpkg-shlibdeps finds them in what was built. The libraries are those of this version and these levels: a build folder may
# hold older ones.
if(NOT CPACK_GENERATOR STREQUAL "DEB")
  return()
endif()
set(folder ${CPACK_ORBID_BUILD}/control)
file(WRITE ${folder}/debian/control "Source: orbid\nPackage: orbid\n")
function(packages_needed result)
  list(TRANSFORM ARGN PREPEND ${CPACK_ORBID_BUILD}/ OUTPUT_VARIABLE files)
  execute_process(
    COMMAND dpkg-shlibdeps -O --ignore-missing-info -l${CPACK_ORBID_BUILD}/lib ${files}
    WORKING_DIRECTORY ${folder} OUTPUT_VARIABLE found ERROR_VARIABLE said RESULT_VARIABLE failed)
  if(failed OR NOT found MATCHES "^shlibs:Depends=([^\n]+)")
    message(FATAL_ERROR "dpkg-shlibdeps: ${said}")
  endif()
  set(${result} "${CMAKE_MATCH_1}" PARENT_SCOPE)
endfunction()
packages_needed(CPACK_DEBIAN_RUNTIME_PACKAGE_DEPENDS ${CPACK_ORBID_LIBRARIES} bin/orbid)
if(CPACK_ORBID_LOADED)
  string(APPEND CPACK_DEBIAN_RUNTIME_PACKAGE_DEPENDS ", ${CPACK_ORBID_LOADED}")
endif()
if(CPACK_ORBID_PLUGIN)
  packages_needed(needed ${CPACK_ORBID_PLUGIN})
  string(APPEND CPACK_DEBIAN_MPI_PACKAGE_DEPENDS ", ${needed}")
endif()
