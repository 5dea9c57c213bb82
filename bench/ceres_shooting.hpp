#pragma once

#include <cstddef>
#include <vector>

/// The peer of identification_bench: multiple shooting as a user of Ceres and Boost.Odeint writes it. Known to neither
/// Eigen nor the library, so that each side is compiled with the flags it likes.
namespace orbid::bench {

/// One interval from node to node.
struct ShootingInterval {
    std::vector<double> durations;  ///< [s], ascending: instants read, the last = the next node's when linked
    std::vector<double> readings;   ///< per duration: Lorenz x, y, z; pendulum the angle; nan = not read
    bool linked = false;            ///< the next interval continues this one
};

struct ShootingTask {
    enum class System { lorenz, pendulum };
    System system = System::lorenz;
    std::vector<ShootingInterval> intervals;
    std::vector<double> nodes;  ///< starts, n per interval
    std::vector<double> theta;  ///< start
    double reading_sd = 1.0;
    std::vector<double> matching_sd;  ///< per coordinate
    double tolerance = 1e-10;         ///< of the flow
    int iterations = 50;              ///< at most
    int threads = 1;
};

struct ShootingSolution {
    std::vector<double> theta;
    std::vector<double> nodes;
    bool converged = false;
    int iterations = 0;
    double cost = 0.0;           ///< half the sum of squares, matching included
    double readings_chi2 = 0.0;  ///< sum of squares of the readings' residuals over their number
    double seconds = 0.0;        ///< of the whole call
    double iterating = 0.0;      ///< [s] of all iterations but the first evaluation
    double derivatives = 0.0;    ///< [s] of these, in evaluations with derivatives
    double linear = 0.0;         ///< [s] of these, in the linear solver
};

/// Ceres with its default trust region (Levenberg-Marquardt) and SPARSE_NORMAL_CHOLESKY, one residual block per
/// interval on theta, its node and the next node.
[[nodiscard]] ShootingSolution solve_with_ceres(const ShootingTask& task);

/// Microseconds of a flow with sensitivities of the peer, over all intervals of the task on one thread, and its states
/// at the last duration.
[[nodiscard]] double microseconds_of_odeint(const ShootingTask& task, std::vector<double>& ends);

}  // namespace orbid::bench
