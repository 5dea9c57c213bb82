# The plug-in orbid-mpi.so, where MPI is found: in the folder orbid beside the library, which loads it when mpiexec or srun
# has started the program (apps/ranks/rank_plugin.hpp). Neither the program nor the library links MPI.
find_package(MPI QUIET COMPONENTS C)
if(NOT MPI_C_FOUND)
  message(STATUS "MPI plug-in: off (needs libopenmpi-dev or another MPI)")
  return()
endif()
message(STATUS "MPI plug-in: ${MPI_C_LIBRARIES}")
add_library(orbid_mpi MODULE apps/ranks/mpi_ranks.cpp)
target_link_libraries(orbid_mpi PRIVATE orbid_flags orbid_library_flags orbid_warnings MPI::MPI_C)
target_compile_definitions(orbid_mpi PRIVATE ORBID_VERSION="${PROJECT_VERSION}")
target_link_options(orbid_mpi PRIVATE LINKER:--no-undefined LINKER:--as-needed)
set_target_properties(orbid_mpi PROPERTIES
  BUILD_WITH_INSTALL_RPATH ON INSTALL_RPATH_USE_LINK_PATH ON  # see cmake/program.cmake
  PREFIX "" OUTPUT_NAME orbid-mpi LIBRARY_OUTPUT_DIRECTORY ${CMAKE_LIBRARY_OUTPUT_DIRECTORY}/orbid)
if(NOT ORBID_SYNTAX_ONLY)
  # As where it is installed: the program finds it from the start.
  add_dependencies(orbid orbid_mpi)
  install(TARGETS orbid_mpi LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/orbid COMPONENT mpi)
endif()
