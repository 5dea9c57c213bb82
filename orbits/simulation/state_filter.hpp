#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "models/system/system.hpp"

namespace orbid::orbits {

/// Readings of one segment that say less than the state, and when they were made.
struct FollowedRecord {
    const models::System& system;
    const Eigen::VectorXd& theta;  ///< shape (q), all parameters
    models::Sensor sensor;         ///< what is read at one instant
    models::Clock clock = models::Clock::time;
    std::vector<double> phases;             ///< of the forcing at each sample, or time on the clock of the inputs
    Eigen::VectorXd at;                     ///< shape (samples): on the clock of the flow, ascending
    std::vector<Eigen::Index> coordinates;  ///< in the place of which each row of `values` is read
    std::vector<Eigen::Index> rows;         ///< of the series, likewise
    Eigen::MatrixXd values;                 ///< shape (rows, samples); nan = missing
    Eigen::VectorXd range;                  ///< shape (n): sizes of the coordinates, > 0
    /// Parameters that are as uncertain as the state: indices into theta, and the sds of their values there.
    std::vector<Eigen::Index> free;
    Eigen::VectorXd free_sd;

    /// A reading minus what is read, of a row of `values`; angles wrapped.
    [[nodiscard]] double difference(Eigen::Index row, double reading, double read) const;
};

/// Errors that a filter assumes.
struct FilterNoise {
    Eigen::VectorXd readings;  ///< shape (rows): sds, > 0
    double process = 0.0;      ///< sd of what the model does not say in one sample, as a share of the ranges, > 0
};

/// What a filter has found.
struct FilteredStates {
    Eigen::MatrixXd states;    ///< shape (n, samples): smoothed
    Eigen::VectorXd theta;     ///< shape (q): with the free parameters at the end
    Eigen::VectorXd surprise;  ///< shape (rows): 1.4826 times the median error of a prediction over one sample
    double misfit = 0.0;       ///< -2 log likelihood of the readings, up to a constant
    std::uint64_t work = 0;    ///< as of track_states()
};

/// The extended Kalman filter, forwards over the first `samples` samples from `start` with sds of 0.3 ranges, and
/// backwards the smoother of Bryson and Frazier: each state from the readings before and after it.
///
///     x_{k+1} = Phi(x_k) + w,  w ~ normal(0, (process range)^2 dt / mean dt);   y_k = sensor(x_k) + v
///
/// Free parameters are part of the state, which they do not change. Wrong starts of theirs would otherwise bend the
/// states to their side.
///
/// Readings are taken one by one, each linearised anew until it settles. Where the flow cannot be computed the state
/// stays, and its sd grows to that of the start. Where that happens too often, or flows take hundreds of steps per
/// sample, nothing can come of it: the way ends early, and its misfit is infinite.
///
/// Source: Bierman, Factorization Methods for Discrete Sequential Estimation (1977), chapter 10 (smoother without
/// inverses).
[[nodiscard]] FilteredStates filtered_states(const FollowedRecord& record, const Eigen::VectorXd& start,
                                             const FilterNoise& noise, Eigen::Index samples);

/// An eighth of what a search for a start may cost with some thousands of readings.
constexpr std::uint64_t most_filter_work = 2'500'000;

/// The same with the errors under which the first 500 readings are most likely: the readings' sds in common proportion
/// downwards from `roughness`, and the process sd on a grid from 1e-5 to 0.3. Of several starts the one under which the
/// first 200 are. Where flows take many steps per sample, errors are looked for until that has cost
/// `most_work`, as of track_states().
/// @param starts     shape (n, starts), at least one.
/// @param roughness  shape (rows): upper bounds of the readings' sds, > 0.
[[nodiscard]] FilteredStates followed_states(const FollowedRecord& record, const Eigen::MatrixXd& starts,
                                             const Eigen::VectorXd& roughness,
                                             std::uint64_t most_work = most_filter_work);

}  // namespace orbid::orbits
