#include "orbits/series_residuals/series_residual.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <cassert>

#include "models/definition/parameter.hpp"
#include "models/system/left_loop.hpp"
#include "orbits/series_residuals/observed_channels.hpp"
#include "orbits/simulation/initial_state.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/section_map.hpp"

namespace orbid::orbits {

using estimator::BlockStatus;
using estimator::BlockValue;

namespace {

double missed(double observed, double predicted, bool angle) {
    const double e = observed - predicted;
    return angle ? models::wrapped(e) : e;
}

}  // namespace

estimator::LatentStructure SeriesResidual::structure() const {
    return free_.empty() ? estimator::LatentStructure::none : estimator::LatentStructure::independent_blocks;
}

const models::System& SeriesResidual::system_of(std::size_t segment) const {
    return with_inputs_.empty() ? *system_ : *with_inputs_[segment];
}

Eigen::VectorXd SeriesResidual::state(std::size_t block, const Eigen::VectorXd& theta,
                                      const Eigen::VectorXd& latents) const {
    assert(latents.size() == std::ssize(free_));
    Eigen::VectorXd x = Eigen::VectorXd::Zero(system_->dimension());
    for (std::size_t i = 0; i < options_.initial.size(); ++i)
        x[static_cast<Eigen::Index>(i)] = options_.initial[i].value;  // free ones are overwritten below
    for (std::size_t i = 0; i < free_.size(); ++i)
        x[free_[i]] = latents[static_cast<Eigen::Index>(i)];
    for (const Eigen::Index i : given_)
        x[i] = theta[options_.initial[static_cast<std::size_t>(i)].parameters[block]];
    return x;
}

Eigen::VectorXd SeriesResidual::guess(std::size_t segment, const Eigen::VectorXd& all) const {
    const Segment& data = series_.segments[segment];
    // All columns that the model knows help to start, also those that do not count as data. Their rows are put
    // together anew, for the series may hold columns that are no coordinates.
    Segment known{data.label, Eigen::MatrixXd(0, data.values.cols()), data.times, {}};
    std::vector<Eigen::Index> coordinates;
    for (Eigen::Index row = 0; row < series_.dimension(); ++row) {
        const Eigen::Index index = system_->coordinate_index(series_.coordinate(row).name);
        if (index < 0) continue;
        known.values.conservativeResize(known.values.rows() + 1, Eigen::NoChange);
        known.values.bottomRows(1) = data.values.row(row);
        coordinates.push_back(index);
    }
    Eigen::VectorXd x =
        initial_state(system_of(segment), all, {known, coordinates, options_.sensor, phase(all, data.times[0])});
    for (std::size_t i = 0; i < options_.initial.size(); ++i) {
        const InitialStateRule& rule = options_.initial[i];
        if (rule.kind == InitialStateRule::Kind::fixed)
            x[static_cast<Eigen::Index>(i)] = rule.value;
        else if (rule.start)
            x[static_cast<Eigen::Index>(i)] = *rule.start;
    }
    return x;
}

Eigen::VectorXd SeriesResidual::guessed_state(std::size_t block) const {
    return guess(blocks_[block].segment, options_.start.size() > 0 ? binding_.values(options_.start) : binding_.base);
}

std::vector<Eigen::VectorXd> SeriesResidual::initial_latents() const {
    std::vector<Eigen::VectorXd> latents;
    for (std::size_t b = 0; b < blocks_.size(); ++b)
        latents.emplace_back(guessed_state(b)(free_));
    return latents;
}

std::vector<BlockValue> SeriesResidual::evaluate(const estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                                 const std::vector<Eigen::VectorXd>& latents, bool derivatives) const {
    assert(latents.size() == blocks_.size());
    std::vector<BlockValue> values(blocks_.size());
    const Eigen::VectorXd all = binding_.values(theta);
    oneapi::tbb::parallel_for(std::size_t{0}, blocks_.size(), [&](std::size_t b) {
        if (!active.layout[b].active) return;
        values[b] = value(blocks_[b], all, state(b, theta, latents[b]), derivatives);
        if (!derivatives || values[b].status != BlockStatus::ok) return;
        for (const Eigen::Index i : given_) {
            const Eigen::Index parameter = options_.initial[static_cast<std::size_t>(i)].parameters[b];
            values[b].e_theta.col(parameter) += values[b].e_z.col(i);
        }
        values[b].e_z = Eigen::MatrixXd(values[b].e_z(Eigen::all, free_));
    });
    models::stop_if_left();
    return values;
}

/// The first phase is series.phase + omega t_first. Beginning later by dt in the same state leads to
/// x(t) + [f(x(t)) - X f(x0)] dt: the solution shifted in time, and X carries back what the state should have moved.
/// Per unit of omega dt = t_first / omega, per second of a delay of the inputs -1.
void SeriesResidual::add_phase_shift(const Eigen::VectorXd& all, const models::System& system, double first_time,
                                     std::span<const double> phases, const Eigen::VectorXd& x0,
                                     models::FlowResult& flow) const {
    Eigen::VectorXd shifts = -delay_slopes(options_.delay, binding_);
    if (system_->kind() == models::Kind::forced)
        shifts += first_time / phase_rate(*system_, all) * frequency_slopes(*system_, binding_);
    if (shifts.isZero(0.0)) return;
    const Eigen::Index n = system_->dimension();
    const Eigen::Index directions = n + shifts.size();
    const Eigen::VectorXd f0 = system.rhs(x0, phases.first(1), all);
    const Eigen::MatrixXd f = system.rhs(flow.states, phases, all);
    for (Eigen::Index k = 0; k < f.cols(); ++k) {
        auto s = flow.sensitivities.middleCols(k * directions, directions);
        const Eigen::VectorXd moved = f.col(k) - s.leftCols(n) * f0;
        s.rightCols(shifts.size()) += moved * shifts.transpose();
    }
}

double SeriesResidual::phase(const Eigen::VectorXd& all, double time) const {
    const double delay = options_.delay ? all[options_.delay->parameter] : 0.0;
    return series_.phase + phase_rate(*system_, all) * time - delay;
}

BlockValue SeriesResidual::value(const Block& block, const Eigen::VectorXd& all, const Eigen::VectorXd& x0,
                                 bool derivatives) const {
    BlockValue failed;
    failed.status = BlockStatus::failed;
    if (!x0.allFinite() || !in_domain(*system_, all)) return failed;
    const Segment& data = series_.segments[block.segment];
    const auto samples = static_cast<std::size_t>(data.times.size());
    const double first = data.times[0];
    std::vector<double> durations(samples), phases(samples);
    for (std::size_t k = 0; k < samples; ++k) {
        durations[k] = data.times[static_cast<Eigen::Index>(k)] - first;
        phases[k] = phase(all, data.times[static_cast<Eigen::Index>(k)]);
    }
    const std::span<const Eigen::Index> free(binding_.parameter);
    const models::System& system = system_of(block.segment);
    auto flow = derivatives ? system.flow_with_sensitivities(x0, phases[0], durations, all, free, models::Clock::time,
                                                             options_.flow)
                            : system.flow(x0, phases[0], durations, all, models::Clock::time, options_.flow);
    if (flow.status != models::FlowStatus::ok) return failed;
    if (derivatives) add_phase_shift(all, system, first, phases, x0, flow);
    const auto read =
        system.readings(options_.sensor, flow.states, phases, all,
                        derivatives ? std::optional<std::span<const Eigen::Index>>(free) : std::nullopt, options_.flow);
    if (read.status != models::FlowStatus::ok) return failed;

    const Eigen::Index n = system_->dimension();
    const auto parameters = std::ssize(binding_.parameter);
    const Eigen::Index directions = n + parameters;
    const auto records = std::ssize(block.records);
    BlockValue result;
    result.e.resize(records);
    Eigen::MatrixXd by_parameter = Eigen::MatrixXd::Zero(derivatives ? records : 0, parameters);
    if (derivatives) result.e_z = Eigen::MatrixXd::Zero(records, n);
    Eigen::RowVectorXd total(directions);
    for (Eigen::Index r = 0; r < records; ++r) {
        const auto [coordinate, k] = block.records[static_cast<std::size_t>(r)];
        if (k < 0) {  // the prior of an initial coordinate: its mean is the reading, the coordinate the prediction
            result.e[r] = missed(block.observed[r], x0[coordinate],
                                 system_->coordinates()[static_cast<std::size_t>(coordinate)].angle);
            total.setZero();
            total[coordinate] = 1.0;
        } else {
            result.e[r] = missed(
                block.observed[r], read.readings(coordinate, k),
                models::reads_angle(options_.sensor, system_->coordinates(), static_cast<std::size_t>(coordinate)));
            if (!derivatives) continue;
            const auto at = read.derivatives.block(coordinate, k * directions, 1, directions);
            total.noalias() = at.leftCols(n) * flow.sensitivity(k, directions);
            total.rightCols(parameters) += at.rightCols(parameters);
        }
        if (!derivatives) continue;
        by_parameter.row(r) = -total.rightCols(parameters);
        result.e_z.row(r) = -total.leftCols(n);
    }
    if (derivatives) result.e_theta = binding_.spread(by_parameter);
    if (!result.e.allFinite() || !result.e_theta.allFinite() || !result.e_z.allFinite()) return failed;
    return result;
}

}  // namespace orbid::orbits
