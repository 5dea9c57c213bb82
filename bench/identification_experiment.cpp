#include "bench/identification_experiment.hpp"

#include <oneapi/tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

namespace orbid::bench {

namespace {
constexpr double turn = 2.0 * std::numbers::pi;
}

void free_parameter(Experiment& e, const std::string& name, double start, double lower) {
    const Eigen::Index index = e.system->parameter_index(name);
    estimator::FreeParameter p;
    p.name = name;
    p.start = start;
    p.lower = lower;
    p.typical_size = e.system->parameters()[static_cast<std::size_t>(index)].typical_size;
    e.binding.parameter.push_back(index);
    e.binding.estimated.push_back(e.binding.estimated_count++);
    e.parameters.push_back(p);
    e.truth.conservativeResize(e.binding.estimated_count);
    e.truth[e.binding.estimated_count - 1] = e.binding.base[index];
}

namespace {

Experiment lorenz(std::size_t samples, double noise, const Eigen::Vector3d& start) {
    Experiment e;
    e.system = models::make_system("lorenz");
    e.binding.base = Eigen::Vector3d(10.0, 28.0, 2.66);
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{0.01, samples, 0};
    options.initial = Eigen::Vector3d(1.0, 0.0, 0.0);
    if (noise > 0.0) options.noise = Eigen::Vector3d::Constant(noise);
    options.seed = 1;
    e.series = orbits::simulate(*e.system, e.binding.base, options).series;
    free_parameter(e, "sigma", start[0], 0.0);
    free_parameter(e, "rho", start[1], 0.0);
    free_parameter(e, "beta", start[2], 0.0);
    return e;
}

}  // namespace

Experiment lorenz_experiment() {
    return lorenz(3001, 0.5, {1.0, 2.2, 0.2});
}

Experiment short_lorenz_experiment() {
    return lorenz(301, 0.0, {9.0, 20.0, 2.0});
}

Experiment pendulum_experiment(std::size_t sections) {
    Experiment e;
    e.system = models::make_system("parametric_pendulum");
    e.binding.base = e.system->default_parameters();
    e.binding.base[e.system->parameter_index("k1")] = 1e-3;
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SectionPlan{sections, 20, {}, 0.0};
    options.seed = 1;
    options.flow = {1e-11, 1e-11, 100000};
    options.sensor.type = models::Sensor::Type::angle_difference;
    options.sensor.delay = 0.01508;
    options.sensor.step = turn / 4096.0;
    options.sensor.rounding = models::Sensor::Rounding::nearest;
    e.sensor = options.sensor;
    e.series = orbits::simulate(*e.system, e.binding.base, options).series;
    free_parameter(e, "l", 0.317 * 1.2, 0.05);
    free_parameter(e, "k1", 2e-3, 0.0);
    free_parameter(e, "k2", 4.85e-4 * 2.0, 0.0);
    free_parameter(e, "k3", 1.9e-4 * 0.5, 0.0);
    return e;
}

Eigen::VectorXd start_of(const Experiment& e) {
    Eigen::VectorXd theta(e.binding.estimated_count);
    for (std::size_t i = 0; i < e.parameters.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = e.parameters[i].start;
    return theta;
}

int threads() {
    return static_cast<int>(
        oneapi::tbb::global_control::active_value(oneapi::tbb::global_control::max_allowed_parallelism));
}

ShootingTask shooting_task(const Experiment& e, Eigen::Index interval, Eigen::Index most) {
    ShootingTask task;
    const bool reads_states = e.sensor.type == models::Sensor::Type::state;
    task.system = reads_states ? ShootingTask::System::lorenz : ShootingTask::System::pendulum;
    task.reading_sd = reads_states ? 0.5 : e.sensor.step / std::sqrt(12.0);
    const double period = reads_states ? 0.01 : turn / 9.09;
    const Eigen::VectorXd start = start_of(e);
    task.theta.assign(start.begin(), start.end());
    task.threads = threads();
    for (const orbits::Segment& segment : e.series.segments) {
        const Eigen::Index last = std::min(segment.values.cols(), most) - 1;
        for (Eigen::Index first = 0; first <= last; first += interval) {
            ShootingInterval piece;
            const Eigen::Index end = std::min(first + interval, last);
            piece.linked = first + interval <= last;
            const auto read = [&](double after, auto... values) {
                piece.durations.push_back(after);
                (piece.readings.push_back(values), ...);
            };
            for (Eigen::Index k = first; k <= end; ++k) {
                const double after = period * static_cast<double>(k - first);
                const bool next = piece.linked && k == end;  // of the next interval
                const double none = std::numeric_limits<double>::quiet_NaN();
                const auto y = segment.values.col(k);
                if (reads_states) {
                    next ? read(after, none, none, none) : read(after, y[0], y[1], y[2]);
                } else {
                    read(after, next ? none : y[0]);
                    if (!next) read(after + e.sensor.delay, y[0] + e.sensor.delay * y[1]);
                }
            }
            const auto y = segment.values.col(first);
            task.nodes.insert(task.nodes.end(), y.begin(), y.end());
            // The difference quotient is the mean over the delay: half of it back to the instant.
            if (!reads_states) {
                const Eigen::MatrixXd f = e.system->rhs(y, std::vector{0.0}, e.binding.values(start));
                task.nodes.back() -= 0.5 * e.sensor.delay * f(1, 0);
            }
            task.intervals.push_back(std::move(piece));
        }
    }
    return task;
}

}  // namespace orbid::bench
