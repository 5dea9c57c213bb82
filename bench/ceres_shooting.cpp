#include "bench/ceres_shooting.hpp"

#include "bench/ceres/peer.h"

namespace orbid::bench {

namespace {

/// A task as plain arrays.
class PlainTask {
public:
    explicit PlainTask(const ShootingTask& task) {
        for (const ShootingInterval& interval : task.intervals) {
            durations_.insert(durations_.end(), interval.durations.begin(), interval.durations.end());
            readings_.insert(readings_.end(), interval.readings.begin(), interval.readings.end());
            ends_.push_back(static_cast<int>(durations_.size()));
            linked_.push_back(interval.linked ? 1 : 0);
        }
        task_.pendulum = task.system == ShootingTask::System::pendulum ? 1 : 0;
        task_.intervals = static_cast<int>(task.intervals.size());
        task_.ends = ends_.data();
        task_.durations = durations_.data();
        task_.readings = readings_.data();
        task_.linked = linked_.data();
        task_.reading_sd = task.reading_sd;
        task_.matching_sd = task.matching_sd.data();
        task_.tolerance = task.tolerance;
        task_.iterations = task.iterations;
        task_.threads = task.threads;
    }
    PlainTask(const PlainTask&) = delete;
    PlainTask& operator=(const PlainTask&) = delete;
    [[nodiscard]] const peer_shooting_task* get() const { return &task_; }

private:
    std::vector<double> durations_, readings_;
    std::vector<int> ends_, linked_;
    peer_shooting_task task_{};
};

}  // namespace

ShootingSolution solve_with_ceres(const ShootingTask& task) {
    ShootingSolution solution;
    solution.theta = task.theta;
    solution.nodes = task.nodes;
    const PlainTask plain(task);
    const peer_shooting_result found = peer_solve_shooting(plain.get(), solution.theta.data(), solution.nodes.data());
    solution.converged = found.converged != 0;
    solution.iterations = found.iterations;
    solution.cost = found.cost;
    solution.readings_chi2 = found.readings_chi2;
    solution.seconds = found.seconds;
    solution.iterating = found.iterating;
    solution.derivatives = found.derivatives;
    solution.linear = found.linear;
    return solution;
}

double microseconds_of_odeint(const ShootingTask& task, std::vector<double>& ends) {
    const std::size_t n = task.system == ShootingTask::System::pendulum ? 2 : 3;
    ends.resize(n * task.intervals.size());
    const PlainTask plain(task);
    return peer_flow_microseconds(plain.get(), task.theta.data(), task.nodes.data(), ends.data());
}

}  // namespace orbid::bench
