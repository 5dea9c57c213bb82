# Run by CPack for each of its generators: the packages that the program and its libraries need, as dpkg-shlibdeps finds them
# in what was built. The libraries are those of this version and these levels: a build folder may hold older ones.
if(NOT CPACK_GENERATOR STREQUAL "DEB")
  return()
endif()
set(folder ${CPACK_ORBID_BUILD}/control)
file(WRITE ${folder}/debian/control "Source: orbid\nPackage: orbid\n")
list(TRANSFORM CPACK_ORBID_LIBRARIES PREPEND ${CPACK_ORBID_BUILD}/ OUTPUT_VARIABLE libraries)
execute_process(
  COMMAND dpkg-shlibdeps -O --ignore-missing-info -l${CPACK_ORBID_BUILD}/lib ${libraries} ${CPACK_ORBID_BUILD}/bin/orbid
  WORKING_DIRECTORY ${folder} OUTPUT_VARIABLE found ERROR_VARIABLE said RESULT_VARIABLE failed)
if(failed OR NOT found MATCHES "^shlibs:Depends=([^\n]+)")
  message(FATAL_ERROR "dpkg-shlibdeps: ${said}")
endif()
set(CPACK_DEBIAN_RUNTIME_PACKAGE_DEPENDS "${CMAKE_MATCH_1}")
if(CPACK_ORBID_LOADED)
  string(APPEND CPACK_DEBIAN_RUNTIME_PACKAGE_DEPENDS ", ${CPACK_ORBID_LOADED}")
endif()
