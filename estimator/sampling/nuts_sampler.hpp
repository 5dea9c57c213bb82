#pragma once

#include <cmath>
#include <cstdint>

#include <Eigen/Core>

#include "estimator/interface/not_finite.hpp"
#include "estimator/interface/random_stream.hpp"
#include "estimator/sampling/nuts.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

/// A run of consecutive points of a trajectory, in the order in which they were made.
struct Trajectory {
    bool whole = false;           ///< neither diverged nor turned back
    Eigen::VectorXd first, last;  ///< momenta of its ends
    Eigen::VectorXd sum;          ///< of all momenta
    double log_weight = -infinity;
    PhasePoint proposal;  ///< one of its points, drawn with weight exp(-H)
};

/// One chain: a place, a step, a metric and its own random numbers.
class NutsSampler {
public:
    NutsSampler(const NegativeLogDensity& density, const NutsOptions& options, const Eigen::MatrixXd& metric,
                std::uint64_t index)
        : density_(density), options_(options), stream_(options.seed, RandomPurpose::posterior_sample, index) {
        set_metric(metric);
    }

    void begin(const Eigen::VectorXd& start);
    void find_step();
    void set_metric(const Eigen::MatrixXd& metric) {
        metric_ = metric;
        factor_ = models::CholeskyFactor(metric).lower();
    }
    void set_step(double step) { step_ = step; }
    void iterate();

    [[nodiscard]] const PhasePoint& point() const { return point_; }
    [[nodiscard]] const Eigen::MatrixXd& metric() const { return metric_; }
    [[nodiscard]] double step() const { return step_; }
    [[nodiscard]] double acceptance() const { return accepted_ / steps_; }  ///< of the last iteration
    [[nodiscard]] double energy() const { return energy_; }
    [[nodiscard]] bool diverged() const { return diverged_; }
    [[nodiscard]] bool saturated() const { return saturated_; }
    [[nodiscard]] long evaluations() const { return evaluations_; }

private:
    void draw_momentum() {
        point_.r.resize(point_.x.size());
        for (double& r : point_.r)
            r = stream_.normal();
    }
    void move(PhasePoint& point, double step) {
        leapfrog(density_, factor_, step, point);
        ++evaluations_;
    }
    [[nodiscard]] bool with_probability_exp(double log_probability) {
        return log_probability >= 0.0 || std::log(stream_.uniform()) < log_probability;
    }
    [[nodiscard]] Trajectory grow(int depth, double step, PhasePoint& edge);

    const NegativeLogDensity& density_;
    const NutsOptions& options_;
    RandomStream stream_;
    Eigen::MatrixXd metric_;
    Eigen::MatrixXd factor_;
    double step_ = 1.0;
    PhasePoint point_;
    double energy_ = 0.0;
    double accepted_ = 0.0;
    double steps_ = 0.0;
    bool diverged_ = false;
    bool saturated_ = false;
    long evaluations_ = 0;
};

}  // namespace orbid::estimator
