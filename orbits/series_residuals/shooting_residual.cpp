#include "orbits/series_residuals/shooting_residual.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "orbits/records/refusal.hpp"
#include "orbits/series_residuals/process_noise.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/state_track.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

ShootingResidual::ShootingResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                   Series series, ShootingOptions options)
    : matching_(options.matching) {
    auto data = read(std::move(system), std::move(binding), std::move(series), std::move(options));
    const VectorXd all =
        data->options.start.size() > 0 ? data->binding.values(data->options.start) : data->binding.base;
    if (data->options.nodes.empty() && needs_tracking(data->system(), data->series, data->options.sensor)) {
        if (data->options.followed)
            data->followed = data->options.followed;
        else
            follow_states(*data, all);
    }
    data->options.followed.reset();
    data->options.following_work = nullptr;
    const FollowedSeries& known = *data->followed;
    // Noise acts between any two readings.
    const bool diffusion = matching_.kind == Continuity::Kind::diffusion;
    data->interval = data->options.interval > 0 ? data->options.interval
                     : diffusion
                         ? 1
                         : shooting_interval(data->systems, known.states.empty() ? all : known.theta, data->series,
                                             data->options.sensor, data->options.segments, known.states);
    data->plan = plan_shooting(data->system(), data->series, data->options.segments, data->observed,
                               data->options.sensor, data->interval);
    data_ = data;
    guess_nodes(all);
    take_ranges(*data);
    check_matching();
    find_process_noise();
    make_groups();
    make_layout();
    begin_matching(start_theta());
}

void ShootingResidual::guess_nodes(const VectorXd& all) {
    const Data& data = *data_;
    const auto& plan = data.plan;
    initial_.latents.resize(plan.nodes.size());
    for (std::size_t f = 0, b = 0; f < data.options.segments.size(); ++f) {
        const std::size_t s = data.options.segments[f];
        std::vector<Index> samples;
        for (std::size_t i = b; i < plan.nodes.size() && plan.nodes[i].segment == s; ++i)
            samples.push_back(plan.nodes[i].sample);
        MatrixXd states;
        if (!data.followed->states.empty()) {
            states = data.followed->states[s](Eigen::all, samples);
        } else if (data.options.nodes.empty()) {
            states = node_states(system_of(s), all, data.series, s, data.options.sensor, samples);
        } else {
            states = data.options.nodes.size() > f ? data.options.nodes[f] : MatrixXd();
            refuse_if(states.rows() != data.system().dimension() || states.cols() != std::ssize(samples),
                      "shooting residual: segment {} has {} nodes of {} coordinates, given are {} of {}",
                      data.series.segments[s].label, samples.size(), data.system().dimension(), states.cols(),
                      states.rows());
        }
        refuse_record_if(
            !states.allFinite(),
            "shooting residual: segment {}: readings do not tell the states: a section needs all coordinates of "
            "the model, samples one at least",
            data.series.segments[s].label);
        for (Index k = 0; k < states.cols(); ++k, ++b)
            initial_.latents[b] = states.col(k);
    }
}

ShootingResidual ShootingResidual::with(const Continuity& matching, const estimator::ActiveSet& active,
                                        std::vector<VectorXd> latents, const VectorXd& theta,
                                        const std::vector<double>& held) const {
    ShootingResidual other = *this;
    other.matching_ = matching;
    other.check_matching();
    other.find_process_noise();
    if (!latents.empty()) {
        assert(latents.size() == initial_.latents.size());
        other.initial_.latents = std::move(latents);
    }
    other.initial_.groups.clear();
    other.make_groups();
    for (std::size_t g = 0; g < held.size(); ++g)
        if (held[g] > 0.0) other.initial_.groups.at(g).scale = {false, held[g], other.initial_.groups[g].scale.prior};
    if (matching.constraints == matching_.constraints) {
        other.initial_.layout = active.layout;
    } else {
        other.make_layout();
        std::vector<estimator::BlockLayout>& layout = other.initial_.layout.edit();
        for (std::size_t b = 0; b < active.layout.size(); ++b)
            layout[b].active = active.layout[b].active;
    }
    other.begin_matching(theta.size() > 0 ? theta : start_theta());
    return other;
}

/// Errors of the readings over their ranges as the predictions from one node's readings to the next one's have them: an
/// upper bound until the parameters are right, see prediction_noise(). One per group of readings.
VectorXd ShootingResidual::predicted_noise(const VectorXd& all) const {
    const Data& data = *data_;
    const auto groups = std::ssize(data.reading_range);
    VectorXd noise = VectorXd::Zero(groups);
    if (!data.followed->states.empty()) {
        // No state is known without the model: what its states at the start missed, one sample ahead.
        for (const ObservedCoordinate& o : data.observed)
            noise[o.group] = data.followed->reading_sd[o.row] / data.reading_range[static_cast<std::size_t>(o.group)];
        return noise;
    }
    // Nor are states known where nodes between readings by formulas are given.
    if (data.options.sensor.type == models::Sensor::Type::function) return noise;
    constexpr std::size_t looks = 500;
    const auto starts = transitions(data.systems, all, data.series, data.options.sensor, data.options.segments,
                                    data.interval, looks, 0);
    const std::span<const Index> no_parameters;
    constexpr std::size_t most_steps = 20000;
    const models::FlowOptions flow{1e-9, 1e-9, std::min(most_steps, data.options.flow.maximum_steps)};
    const auto predicted = predictions(data.systems, all, starts, no_parameters, data.plan.clock, flow);
    std::uint64_t cost = 0;
    for (const Prediction& one : predicted)
        cost += one.cost;
    data.work.fetch_add(flow_work(data.system(), cost, data.system().dimension()), std::memory_order_relaxed);
    const VectorXd per_coordinate = prediction_noise(predicted, error_sizes(data.options.sensor, data.range));
    for (const ObservedCoordinate& o : data.observed) {
        double& here = noise[o.group];
        here = here > 0.0 ? std::min(here, per_coordinate[o.coordinate]) : per_coordinate[o.coordinate];
    }
    return noise;
}

VectorXd ShootingResidual::start_theta() const {
    const models::ParameterBinding& binding = data_->binding;
    if (data_->options.start.size() > 0) return data_->options.start;
    VectorXd theta = VectorXd::Zero(binding.estimated_count);
    for (std::size_t j = 0; j < binding.parameter.size(); ++j)
        theta[binding.estimated[j]] = binding.base[binding.parameter[j]];
    return theta;
}

/// The first stage: matching as loose as the nodes that the data say leave it.
void ShootingResidual::begin_matching(const VectorXd& theta) {
    const Data& data = *data_;
    const VectorXd noise = predicted_noise(data.binding.values(theta));
    for (Index g = 0; g < noise.size(); ++g) {
        estimator::Group& group = initial_.groups[static_cast<std::size_t>(g)];
        const bool told = group.scale.value > group.floor;  // by the caller
        if (group.scale.estimate && !group.factor && !told && noise[g] > 0.0)
            group.scale.value = std::max(group.floor, noise[g] * data.reading_range[static_cast<std::size_t>(g)]);
    }
    unit_ = data.range;
    if (noise_)
        for (const NoiseChain& chain : noise_->chains)
            for (const Index i : chain.coordinates)
                unit_[i] = data.range[chain.coordinates.front()] * noise_->usual.deviation[i] /
                           noise_->usual.deviation[chain.coordinates.front()];
    initial_.memory.assign(1, VectorXd::Zero(memory_size));
    initial_.is_intermediate_stage = false;
    VectorXd& memory = initial_.memory.front();
    if (matching_.constraints) return;
    find_noise(initial_);
    double& end = memory[final_tightness];
    if (matching_.kind != Continuity::Kind::exact && matching_.sd.size() > 0) {
        end = std::exp(matching_.sd.cwiseQuotient(data.range).array().log().mean());
        unit_ = matching_.sd / end;
    } else {
        end = matching_.estimate ? memory[reading_noise] * estimated_tightness
                                 : exact_matching(memory[reading_noise], sampled());
    }
    memory[tightness] = end;
    apply_matching(initial_);
    const Defect now = defect(initial_, theta, initial_.latents, unit_);
    const double loose = std::sqrt(now.rms.cwiseQuotient(unit_).squaredNorm() / static_cast<double>(unit_.size()));
    if (std::isfinite(loose)) memory[tightness] = std::max(end, loose);
    apply_matching(initial_);
}

/// Largest error of a reading over its range, as far as the groups know it.
void ShootingResidual::find_noise(estimator::ActiveSet& active) const {
    constexpr double unknown = 1e-3;  // with known sds only: between an encoder's and a bad instrument's
    double largest = 0.0;
    for (std::size_t g = 0; g < data_->reading_range.size(); ++g)
        if (!active.groups[g].factor)
            largest = std::max(largest, active.groups[g].scale.value / data_->reading_range[g]);
    active.memory.front()[reading_noise] = largest > 0.0 ? largest : unknown;
}

void ShootingResidual::apply_matching(estimator::ActiveSet& active) const {
    const VectorXd& memory = active.memory.front();
    active.is_intermediate_stage = memory[tightness] > memory[final_tightness];
    const std::size_t first = data_->reading_range.size();
    const double least =
        noise_ ? least_diffusion * memory[reading_noise] : least_matching(memory[reading_noise], sampled());
    const VectorXd unit = noise_ ? noise_scale_unit() : unit_;
    for (Index i = 0; i < unit.size(); ++i) {
        estimator::Group& group = active.groups[first + static_cast<std::size_t>(i)];
        group.scale.value = memory[tightness] * unit[i];
        if (matching_.estimate) group.floor = std::min(least * unit[i], group.scale.value);
    }
}

estimator::RefreshReport ShootingResidual::update_active_set(estimator::ActiveSet& active, const VectorXd& theta,
                                                             const std::vector<VectorXd>& latents,
                                                             const VectorXd& /*scales*/) const {
    if (!active.is_intermediate_stage) return {};
    // Continuity that is tighter than the readings leaves their errors in the residuals; before that the nodes follow
    // the readings, and predictions from one reading to the next tell more.
    constexpr double tight = 0.1;
    VectorXd& memory = active.memory.front();
    const bool loose = !(memory[tightness] < tight * memory[reading_noise]);
    const bool known_states =
        data_->followed->states.empty() && data_->options.sensor.type != models::Sensor::Type::function;
    if (!loose || !known_states)
        read_scales(active, theta, latents, loose);
    else
        predict_scales(active, theta);
    find_noise(active);
    const double noise = memory[reading_noise];
    double& end = memory[final_tightness];
    if (matching_.kind == Continuity::Kind::exact) end = std::min(memory[tightness], exact_matching(noise, sampled()));
    const double share = next_share(noise, sampled() && known_states);
    memory[tightness] = sampled() && !loose ? end : std::max(end, share * memory[tightness]);
    apply_matching(active);
    return {};
}

bool ShootingResidual::tighten(estimator::ActiveSet& active) const {
    constexpr double far_smaller = 0.7;
    if (!matching_.is_exact_with_slack()) return false;
    VectorXd& memory = active.memory.front();
    const double before = memory[reading_noise];
    find_noise(active);
    if (!(memory[reading_noise] < far_smaller * before)) {
        memory[reading_noise] = before;
        return false;
    }
    memory[final_tightness] = memory[tightness] = exact_matching(memory[reading_noise], sampled());
    apply_matching(active);
    return true;
}

/// Scales of readings that are still to be estimated, from predictions at theta.
void ShootingResidual::predict_scales(estimator::ActiveSet& active, const VectorXd& theta) const {
    const VectorXd noise = predicted_noise(data_->binding.values(theta));
    for (Index g = 0; g < noise.size(); ++g) {
        estimator::Group& group = active.groups[static_cast<std::size_t>(g)];
        if (!group.scale.estimate || group.factor || !(noise[g] > 0.0)) continue;
        const double told = noise[g] * data_->reading_range[static_cast<std::size_t>(g)];
        // An upper bound: never upwards.
        group.scale.value = std::max(group.floor, std::min(group.scale.value, told));
    }
}

}  // namespace orbid::orbits
