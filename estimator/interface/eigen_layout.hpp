#pragma once

#include <Eigen/Core>

// Matrices are passed into and out of the library. Both sides must align and allocate them alike, whatever -march they
// are compiled for. Every public header with Eigen types includes this one or that of models/, which the estimator may
// not include.
static_assert(EIGEN_MAX_ALIGN_BYTES == 16 && EIGEN_MAX_STATIC_ALIGN_BYTES == 16 && EIGEN_MALLOC_ALREADY_ALIGNED == 0,
              "compile with -DEIGEN_MAX_ALIGN_BYTES=16 -DEIGEN_MAX_STATIC_ALIGN_BYTES=16 "
              "-DEIGEN_MALLOC_ALREADY_ALIGNED=0, as orbid's CMake target and pkg-config do");
