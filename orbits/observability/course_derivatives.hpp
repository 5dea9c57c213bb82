#pragma once

#include <span>

#include <Eigen/Core>

#include "models/system/system.hpp"

namespace orbid::orbits {

/// A course of a model and what is read along it.
struct ReadCourse {
    const models::System& system;  ///< with its measured inputs
    const models::Sensor& sensor;
    std::span<const Eigen::Index> observed;  ///< coordinates that are read
    Eigen::VectorXd state;                   ///< shape (n): where it begins
    double phase = 0.0;                      ///< there
    double longest = 1.0;                    ///< [s]: it is followed this far at most
};

/// How the readings of a course depend on its first state and on parameters.
struct CourseDerivatives {
    Eigen::MatrixXd by_state;       ///< shape (m, n); no rows: the course cannot be followed
    Eigen::MatrixXd by_parameters;  ///< shape (m, f)
    /// The same, of the sums of the terms without their signs: what the rounding of an entry is relative to.
    Eigen::MatrixXd state_terms, parameter_terms;
    double duration = 0.0;  ///< [s] that the course was followed
};

/// Derivatives of the readings at times from a 1e-5th of the course to its end, closer together where it begins.
///
/// A course is followed as long as errors of its first state grow by less than a factor of 1000 (coordinates in units
/// of their largest values), so that integration errors stay far below every derivative. Each row is divided by its
/// norm, coordinates and parameters in units of their sizes: late readings, which chaos makes sensitive to everything,
/// and early ones count alike. This changes no rank.
///
/// @param theta  shape (q)
/// @param free   f parameters
[[nodiscard]] CourseDerivatives course_derivatives(const ReadCourse& course, const Eigen::VectorXd& theta,
                                                   std::span<const Eigen::Index> free);

}  // namespace orbid::orbits
