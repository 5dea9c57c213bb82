#include "models/system/kernel_system.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <fmt/format.h>

#include <algorithm>
#include <numbers>
#include <stdexcept>

#include "models/system/argument_check.hpp"
#include "models/system/left_loop.hpp"

namespace orbid::models {

namespace {

/// Room for the results of a flow of m durations, with sensitivities in d directions.
FlowOutput room_in(FlowResult& result, Eigen::Index n, Eigen::Index m, Eigen::Index d) {
    result.states.resize(n, m);
    result.sensitivities.setZero(n, m * d);
    result.stopped_state.resize(n);
    return {result.states.data(), result.stopped_state.data(), d > 0 ? result.sensitivities.data() : nullptr, nullptr};
}

void say_how_it_ended(FlowResult& result, const FlowEnd& end) {
    result.status = end.status;
    result.stopped_after = end.stopped_after;
    result.steps = end.steps;
    result.crossings = end.crossings;
    result.stickings = end.stickings;
}

}  // namespace

KernelSystem::KernelSystem(std::shared_ptr<const Kernel> kernel, std::shared_ptr<const InputSignal> signal)
    : kernel_(std::move(kernel)), signal_(std::move(signal)) {}

std::optional<Symmetry> KernelSystem::symmetry() const {
    const auto signs = kernel_->symmetry_signs();
    if (signs.empty()) return std::nullopt;
    return Symmetry{{signs.begin(), signs.end()}, kernel_->symmetry_phase_shift()};
}

void KernelSystem::require_input() const {
    if (!inputs().empty() && !signal_)
        throw std::logic_error(fmt::format("model {} reads measured inputs and was given none", name()));
}

void KernelSystem::require_autonomous() const {
    if (kind() != Kind::autonomous)
        throw std::logic_error(fmt::format("model {} is not autonomous: its sections are at a phase", name()));
}

const double* KernelSystem::input_at(double phase, std::vector<double>& values) const {
    values.resize(inputs().size());
    if (signal_) signal_->evaluate(signal_->piece_at(phase), phase, values.data());
    return values.data();
}

bool KernelSystem::smooth(const Eigen::VectorXd& theta) const {
    check_parameters(*this, theta);
    return kernel_->smooth(theta.data());
}

double KernelSystem::period(const Eigen::VectorXd& theta, Clock clock) const {
    const auto frequency = kernel_->forcing_frequency();
    if (!frequency) throw std::logic_error(fmt::format("model {} is not forced: it has no period of forcing", name()));
    check_parameters(*this, theta);
    const double turn = 2.0 * std::numbers::pi;
    return clock == Clock::phase ? turn : turn / theta[static_cast<Eigen::Index>(*frequency)];
}

std::optional<Eigen::Index> KernelSystem::forcing_frequency() const {
    const auto index = kernel_->forcing_frequency();
    return index ? std::optional(static_cast<Eigen::Index>(*index)) : std::nullopt;
}

bool KernelSystem::at_rest(const Eigen::VectorXd& state, const Eigen::VectorXd& theta) const {
    check_parameters(*this, theta);
    check_state(*this, state);
    if (!kernel_->at_rest(state.data(), theta.data())) return false;
    // Friction that holds the state is none of size. What else stands still was judged by rates of states of size 1.
    if (state_size_ >= 1.0 || !smooth(theta)) return true;
    const std::vector<double> phases{0.0, 2.0, 4.0};
    Eigen::MatrixXd rates = rhs(state.replicate(1, std::ssize(phases)), phases, theta);
    if (kind() == Kind::map) rates.colwise() -= state;
    constexpr double rest = 1e-12;
    return ((rates.cwiseAbs().array().colwise() / (state_size_ + state.array().abs())) <= rest).all();
}

Eigen::MatrixXd KernelSystem::rhs(const Eigen::MatrixXd& states, std::span<const double> phases,
                                  const Eigen::VectorXd& theta) const {
    check_parameters(*this, theta);
    check_columns(*this, states, phases);
    require_input();
    std::vector<double> input;
    Eigen::MatrixXd f(states.rows(), states.cols());
    for (Eigen::Index k = 0; k < states.cols(); ++k) {
        const double phase = phases[static_cast<std::size_t>(k)];
        kernel_->rhs(phase, states.col(k).data(), theta.data(), input_at(phase, input), f.col(k).data());
    }
    return f;
}

Eigen::MatrixXd KernelSystem::rhs_derivatives(const Eigen::MatrixXd& states, std::span<const double> phases,
                                              const Eigen::VectorXd& theta, std::span<const Eigen::Index> free) const {
    check_parameters(*this, theta);
    check_columns(*this, states, phases);
    check_free(*this, free);
    require_input();
    const Eigen::Index d = dimension() + static_cast<Eigen::Index>(free.size());
    std::vector<double> input;
    Eigen::MatrixXd derivatives(dimension(), states.cols() * d);
    for (Eigen::Index k = 0; k < states.cols(); ++k) {
        const double phase = phases[static_cast<std::size_t>(k)];
        kernel_->rhs_derivatives(phase, states.col(k).data(), theta.data(), input_at(phase, input), free,
                                 derivatives.col(k * d).data());
    }
    return derivatives;
}

FlowStart KernelSystem::start_of(const Eigen::VectorXd& x0, double phase, const Eigen::VectorXd& theta, Clock clock,
                                 const FlowOptions& options) const {
    require_input();
    return {x0.data(), phase, theta.data(), clock, for_kernel(options), signal_.get()};
}

FlowResult KernelSystem::flow(const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                              const Eigen::VectorXd& theta, Clock clock, const FlowOptions& options) const {
    check_flow(*this, x0, phase, durations, theta, {}, clock, options);
    FlowResult result;
    const FlowOutput output = room_in(result, dimension(), std::ssize(durations), 0);
    say_how_it_ended(result, kernel_->flow(start_of(x0, phase, theta, clock, options), durations, {}, output));
    return result;
}

FlowResult KernelSystem::flow_with_sensitivities(const Eigen::VectorXd& x0, double phase,
                                                 std::span<const double> durations, const Eigen::VectorXd& theta,
                                                 std::span<const Eigen::Index> free, Clock clock,
                                                 const FlowOptions& options) const {
    check_flow(*this, x0, phase, durations, theta, free, clock, options);
    FlowResult result;
    const FlowOutput output = room_in(result, dimension(), std::ssize(durations), dimension() + std::ssize(free));
    say_how_it_ended(result, kernel_->flow(start_of(x0, phase, theta, clock, options), durations, free, output));
    return result;
}

std::vector<FlowResult> KernelSystem::flows(const Eigen::MatrixXd& starts, std::span<const double> phases,
                                            std::span<const double> durations, const Eigen::VectorXd& theta,
                                            std::optional<std::span<const Eigen::Index>> free, Clock clock,
                                            const FlowOptions& options) const {
    check_parameters(*this, theta);
    check_columns(*this, starts, phases);
    require_input();
    const auto total = static_cast<std::size_t>(starts.cols());
    if (total == 0) return {};
    check_flow(*this, starts.col(0), phases[0], durations, theta, free.value_or(std::span<const Eigen::Index>{}), clock,
               options);
    const FlowStarts all{starts.data(), phases.data(), total, theta.data(), clock, for_kernel(options)};
    // Flows of forced models that begin at the same phase share their steps. Packs of these do not count them as they
    // go, and there are some thousand of them at most.
    constexpr std::size_t smallest_budget = 10000;
    const bool shared = kind() == Kind::forced &&
                        std::all_of(phases.begin(), phases.end(), [&](double phase) { return phase == phases[0]; });
    // A step of a pack takes as long as two to three of a trajectory alone.
    constexpr std::size_t worth_a_pack = 3;
    const auto batch = total < worth_a_pack || (shared && options.maximum_steps < smallest_budget)
                           ? nullptr
                           : kernel_->flow_batch(all, durations, free.value_or(std::span<const Eigen::Index>{}));
    if (!batch) return System::flows(starts, phases, durations, theta, free, clock, options);
    const Eigen::Index directions = free ? dimension() + std::ssize(*free) : 0;
    std::vector<FlowResult> results(total);
    // Blocks of 256 fill the packs of those that meet a switching surface at once; fewer where threads would stay idle.
    // No result depends on it.
    const auto threads = static_cast<std::size_t>(oneapi::tbb::this_task_arena::max_concurrency());
    const std::size_t block = std::clamp((total + threads - 1) / threads, std::size_t{16}, std::size_t{256});
    oneapi::tbb::parallel_for(std::size_t{0}, (total + block - 1) / block, [&](std::size_t b) {
        const std::size_t first = b * block, size = std::min(block, total - first);
        std::vector<FlowOutput> outputs;
        std::vector<FlowEnd> ends(size);
        for (std::size_t i = first; i < first + size; ++i)
            outputs.push_back(room_in(results[i], dimension(), std::ssize(durations), directions));
        batch->run(first, size, outputs.data(), ends.data());
        for (std::size_t i = 0; i < size; ++i)
            say_how_it_ended(results[first + i], ends[i]);
    });
    stop_if_left();
    return results;
}

SecondOrderResult KernelSystem::flow_with_second_derivatives(const Eigen::VectorXd& x0, double phase,
                                                             std::span<const double> durations,
                                                             const Eigen::VectorXd& theta,
                                                             std::span<const Eigen::Index> free, Clock clock,
                                                             const FlowOptions& options) const {
    check_flow(*this, x0, phase, durations, theta, free, clock, options);
    const Eigen::Index directions = dimension() + std::ssize(free);
    SecondOrderResult result;
    FlowOutput output = room_in(result, dimension(), std::ssize(durations), directions);
    result.second_derivatives.setZero(dimension(), std::ssize(durations) * directions * directions);
    output.second_derivatives = result.second_derivatives.data();
    say_how_it_ended(result, kernel_->flow(start_of(x0, phase, theta, clock, options), durations, free, output));
    return result;
}

CrossingResult KernelSystem::crossings(const Eigen::VectorXd& x0, const Section& section, std::size_t count,
                                       double longest, const Eigen::VectorXd& theta,
                                       std::optional<std::span<const Eigen::Index>> free,
                                       const FlowOptions& options) const {
    require_autonomous();
    check_flow(*this, x0, 0.0, {}, theta, free.value_or(std::span<const Eigen::Index>{}), Clock::time, options);
    check_section(*this, section, longest);
    const auto m = static_cast<Eigen::Index>(count);
    const Eigen::Index directions = free ? dimension() + static_cast<Eigen::Index>(free->size()) : 0;
    CrossingResult result;
    result.times.setZero(m);
    result.states.setZero(dimension(), m);
    result.sensitivities.setZero(dimension(), m * directions);
    result.time_sensitivities.setZero(directions, m);
    result.stopped_state.resize(dimension());
    const SectionPlane plane{
        {section.normal.data(), static_cast<std::size_t>(section.normal.size())}, section.offset, section.direction};
    const FlowOutput output{result.states.data(),
                            result.stopped_state.data(),
                            free ? result.sensitivities.data() : nullptr,
                            nullptr,
                            result.times.data(),
                            free ? result.time_sensitivities.data() : nullptr};
    const FlowEnd end = kernel_->crossings(start_of(x0, 0.0, theta, Clock::time, options), plane, count, longest,
                                           free.value_or(std::span<const Eigen::Index>{}), output);
    result.status = end.status;
    result.stopped_after = end.stopped_after;
    result.steps = end.steps;
    if (end.crossings < count) {
        const auto reached = static_cast<Eigen::Index>(end.crossings);
        result.times.conservativeResize(reached);
        result.states.conservativeResize(Eigen::NoChange, reached);
        result.sensitivities.conservativeResize(Eigen::NoChange, reached * directions);
        result.time_sensitivities.conservativeResize(Eigen::NoChange, reached);
    }
    return result;
}

EnsembleResult KernelSystem::ensemble(const Eigen::MatrixXd& starts, double phase, std::size_t periods,
                                      const Eigen::VectorXd& theta, const FlowOptions& options) const {
    check_parameters(*this, theta);
    check_options(options);
    const auto count = static_cast<std::size_t>(starts.cols());
    check_columns(*this, starts, std::vector<double>(count, phase));
    if (kind() == Kind::autonomous)
        throw std::logic_error(fmt::format("model {} is not forced: it has no section by phase", name()));
    EnsembleResult result;
    result.sections.resize(count);
    result.status.assign(count, FlowStatus::ok);
    std::vector<double*> sections(count);
    std::vector<std::size_t> columns(count, 0);
    for (std::size_t i = 0; i < count; ++i) {
        result.sections[i].resize(dimension(), static_cast<Eigen::Index>(periods + 1));
        sections[i] = result.sections[i].data();
    }
    // Small enough that every thread has work; no result depends on it. Four lanes of one vector register take the time
    // of one, so fewer would only heat the other cores.
    const auto threads = static_cast<std::size_t>(oneapi::tbb::this_task_arena::max_concurrency());
    const std::size_t most = kernel_->ensemble_block();
    const std::size_t block = std::clamp((count + threads - 1) / threads, std::min(most, std::size_t{4}), most);
    const FlowOptions asked = for_kernel(options);
    oneapi::tbb::parallel_for(std::size_t{0}, (count + block - 1) / block, [&](std::size_t b) {
        const std::size_t first = b * block, size = std::min(block, count - first);
        kernel_->ensemble(starts.data() + first * static_cast<std::size_t>(starts.rows()), size, phase, periods,
                          theta.data(), asked, sections.data() + first, columns.data() + first,
                          result.status.data() + first);
    });
    stop_if_left();
    for (std::size_t i = 0; i < count; ++i)
        if (columns[i] <= periods)
            result.sections[i].conservativeResize(Eigen::NoChange, static_cast<Eigen::Index>(columns[i]));
    return result;
}

EnsembleResult KernelSystem::crossing_ensemble(const Eigen::MatrixXd& starts, const Section& section, std::size_t count,
                                               double longest, const Eigen::VectorXd& theta,
                                               const FlowOptions& options) const {
    require_autonomous();
    const std::vector<double> phases(static_cast<std::size_t>(starts.cols()), 0.0);
    check_columns(*this, starts, phases);
    EnsembleResult result;
    result.sections.resize(phases.size());
    result.times.resize(phases.size());
    result.status.assign(phases.size(), FlowStatus::ok);
    oneapi::tbb::parallel_for(std::size_t{0}, phases.size(), [&](std::size_t i) {
        const Eigen::VectorXd start = starts.col(static_cast<Eigen::Index>(i));
        const CrossingResult run = crossings(start, section, count, longest, theta, std::nullopt, options);
        result.status[i] = run.status;
        result.sections[i].resize(dimension(), run.states.cols() + 1);
        result.sections[i] << start, run.states;
        for (std::size_t c = 0; c < coordinates().size(); ++c)
            if (coordinates()[c].angle)
                for (double& angle : result.sections[i].row(static_cast<Eigen::Index>(c)).reshaped())
                    angle = wrapped(angle);
        result.times[i].resize(run.times.size() + 1);
        result.times[i] << 0.0, run.times;
    });
    stop_if_left();
    return result;
}

}  // namespace orbid::models
