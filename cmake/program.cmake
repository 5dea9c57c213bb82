# What is installed beside the library for who uses the program: itself, its manual page, completions, the schemas of jobs and campaigns,
# pages and example jobs. All text that the program can write about itself is written by it.
include(GNUInstallDirs)
if(ORBID_SYNTAX_ONLY)
  return()
endif()

# Relative: the tree works wherever it is put.
file(RELATIVE_PATH library_folder /${CMAKE_INSTALL_BINDIR} /${CMAKE_INSTALL_LIBDIR})
set(library_folders "$ORIGIN/../lib" "$ORIGIN/${library_folder}")
list(REMOVE_DUPLICATES library_folders)
set_target_properties(orbid PROPERTIES INSTALL_RPATH "${library_folders}")
# A path of the build's own CMake ends by a colon: an empty entry, which is the current folder, where a stranger may have
# put a library.
if(NOT CMAKE_SKIP_INSTALL_RPATH)
  set_target_properties(orbid PROPERTIES BUILD_WITH_INSTALL_RPATH ON)
endif()
install(TARGETS orbid RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT runtime)

set(texts ${CMAKE_BINARY_DIR}/texts)
add_custom_command(OUTPUT ${texts}/orbid.1 ${texts}/orbid.bash ${texts}/orbid.zsh
  COMMAND ${CMAKE_COMMAND} -E make_directory ${texts}
  COMMAND orbid man > ${texts}/orbid.1
  COMMAND orbid completion bash > ${texts}/orbid.bash
  COMMAND orbid completion zsh > ${texts}/orbid.zsh
  DEPENDS orbid orbid_library
  COMMENT "Writing the manual page and completions" VERBATIM)
add_custom_target(orbid_texts ALL DEPENDS ${texts}/orbid.1 ${texts}/orbid.bash ${texts}/orbid.zsh)
install(FILES ${texts}/orbid.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME orbid
  COMPONENT runtime)
install(FILES ${texts}/orbid.zsh DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions RENAME _orbid
  COMPONENT runtime)
install(FILES docs/orbid-job.schema.json docs/orbid-campaign.schema.json DESTINATION ${CMAKE_INSTALL_DATADIR}/orbid COMPONENT runtime)

# Example jobs with their data, each set of data beside its notice. Pages name their folder as the source tree does. Links of
# pages into tests/ lead nowhere here: what they name as evidence is source, which packages do not hold.
set(documents ${CMAKE_INSTALL_DATADIR}/doc/orbid)
install(DIRECTORY configs/ DESTINATION ${documents}/examples COMPONENT runtime FILES_MATCHING
  PATTERN "*.json" PATTERN "*.csv" PATTERN "*.md")
file(CREATE_LINK examples ${CMAKE_BINARY_DIR}/configs SYMBOLIC)
install(FILES ${CMAKE_BINARY_DIR}/configs DESTINATION ${documents} COMPONENT runtime)
install(DIRECTORY docs/ DESTINATION ${documents}/docs COMPONENT runtime FILES_MATCHING
  PATTERN "*.md" PATTERN "*.svg" PATTERN "*.png" PATTERN "*.csv" PATTERN site EXCLUDE)
install(FILES README.md CONTRIBUTING.md CHANGELOG.md DESTINATION ${documents} COMPONENT runtime)
install(FILES ${CMAKE_BINARY_DIR}/third_party_licences.txt ${CMAKE_BINARY_DIR}/orbid.spdx.json DESTINATION ${documents} COMPONENT runtime)
install(DIRECTORY examples/ DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/liborbid-dev/examples COMPONENT development
  FILES_MATCHING PATTERN "*.cpp" PATTERN "*.csv" PATTERN "*.md" PATTERN CMakeLists.txt PATTERN build EXCLUDE)

# As the policy of Debian asks for it: what gzip is there for is compressed, without its date.
find_program(ORBID_GZIP gzip)
function(install_compressed file folder name component)
  if(ORBID_GZIP)
    string(MAKE_C_IDENTIFIER ${component}_${name} target)
    set(compressed ${texts}/${component}/${name}.gz)
    add_custom_command(OUTPUT ${compressed}
      COMMAND ${CMAKE_COMMAND} -E make_directory ${texts}/${component}
      COMMAND ${ORBID_GZIP} -9nc ${file} > ${compressed}
      DEPENDS ${file} VERBATIM)
    add_custom_target(compressed_${target} ALL DEPENDS ${compressed})
    if(file MATCHES "^${texts}/orbid")
      add_dependencies(compressed_${target} orbid_texts)
    endif()
    install(FILES ${compressed} DESTINATION ${folder} COMPONENT ${component})
  else()
    install(FILES ${file} DESTINATION ${folder} RENAME ${name} COMPONENT ${component})
  endif()
endfunction()
install_compressed(${texts}/orbid.1 ${CMAKE_INSTALL_MANDIR}/man1 orbid.1 runtime)
# The packages' own changelog; its date follows SOURCE_DATE_EPOCH.
string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
file(CONFIGURE OUTPUT ${texts}/changelog.Debian @ONLY CONTENT
"orbid (@PROJECT_VERSION@-1) unstable; urgency=medium

  * Version @PROJECT_VERSION@; what changed is in changelog.gz.

 -- @ORBID_MAINTAINER@  @date@
")
set(components runtime development)
set(package_of_runtime orbid)
set(package_of_development liborbid-dev)
if(TARGET orbid_mpi)
  list(APPEND components mpi)
  set(package_of_mpi orbid-mpi)
endif()
foreach(component IN LISTS components)
  set(package ${package_of_${component}})
  set(folder ${CMAKE_INSTALL_DATADIR}/doc/${package})
  install(FILES LICENSE DESTINATION ${folder} RENAME copyright COMPONENT ${component})
  install_compressed(${CMAKE_SOURCE_DIR}/CHANGELOG.md ${folder} changelog ${component})
  install_compressed(${texts}/changelog.Debian ${folder} changelog.Debian ${component})
endforeach()
