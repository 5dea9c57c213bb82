#pragma once

#include <Eigen/Core>

// Matrices cross the border of the library: both sides must align and allocate them alike, whatever -march they are
// compiled for. Each public header with types of Eigen says so through this one or that of models/, of which the
// estimator knows nothing.
static_assert(EIGEN_MAX_ALIGN_BYTES == 16 && EIGEN_MAX_STATIC_ALIGN_BYTES == 16 && EIGEN_MALLOC_ALREADY_ALIGNED == 0,
              "compile with -DEIGEN_MAX_ALIGN_BYTES=16 -DEIGEN_MAX_STATIC_ALIGN_BYTES=16 "
              "-DEIGEN_MALLOC_ALREADY_ALIGNED=0, as orbid's CMake target and pkg-config do");
