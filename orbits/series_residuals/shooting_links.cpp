#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/arithmetic/median.hpp"
#include "orbits/series_residuals/process_noise.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"
#include "orbits/simulation/node_state.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double normal_median = 1.4826;  // sd of a normal error over the median of its absolute value

/// Small, and different for every coordinate and state; the same at every call.
VectorXd aside(Index coordinates, Index place) {
    constexpr double size = 0.01;
    VectorXd result(coordinates);
    for (Index i = 0; i < coordinates; ++i) {
        const double turn = static_cast<double>(place * coordinates + i + 1) * std::numbers::phi;
        result[i] = size * (turn - std::floor(turn) - 0.5);
    }
    return result;
}

}  // namespace

/// Where noise enters, and what it adds over the intervals of the plan. Equations are compared at some of the nodes.
void ShootingResidual::find_process_noise() {
    noise_.reset();
    if (matching_.kind != Continuity::Kind::diffusion) return;
    const Data& data = *data_;
    const auto& nodes = data.plan.nodes;
    const VectorXd all = data.binding.values(start_theta());
    constexpr std::size_t looks = 16;
    const std::size_t stride = std::max<std::size_t>(1, nodes.size() / looks);
    std::vector<double> phases;
    MatrixXd states(data.system().dimension(), 0);
    for (std::size_t b = 0; b < nodes.size() && states.cols() < static_cast<Index>(looks); b += stride) {
        // States of one segment go with its inputs.
        if (nodes[b].segment != nodes.front().segment) break;
        const Segment& segment = data.series.segments[nodes[b].segment];
        phases.push_back(phase_at(data.system(), all, data.series, segment, nodes[b].sample) - data.later(all));
        states.conservativeResize(Eigen::NoChange, states.cols() + 1);
        // A little off the course: coordinates that are equal on it by chance are no derivatives of each other.
        states.rightCols(1) = initial_.latents[b] + aside(states.rows(), states.cols()).cwiseProduct(data.range);
    }
    auto noise = std::make_shared<ProcessNoise>();
    noise->chains = noise_chains(system_of(nodes.front().segment), states, phases, all);
    std::vector<double> durations;
    for (const PlannedNode& node : nodes) {
        const InstantPattern& pattern = data.plan.patterns[node.pattern];
        if (node.linked) durations.push_back(pattern.instants[static_cast<std::size_t>(pattern.match)].after);
    }
    noise->duration = durations.empty() ? 1.0 : models::upper_median(std::move(durations));
    noise->usual = link_errors(noise->chains, noise->duration);
    for (const InstantPattern& pattern : data.plan.patterns)
        noise->links.push_back(
            pattern.match < 0
                ? LinkErrors{}
                : link_errors(noise->chains, pattern.instants[static_cast<std::size_t>(pattern.match)].after));
    noise_ = std::move(noise);
}

std::vector<Index> ShootingResidual::noisy_coordinates() const {
    std::vector<Index> first;
    if (noise_)
        for (const NoiseChain& chain : noise_->chains)
            first.push_back(chain.coordinates.front());
    return first;
}

/// Scales of the groups of a diffusion over the tightness of matching.
VectorXd ShootingResidual::noise_scale_unit() const {
    const std::vector<Index> first = noisy_coordinates();
    VectorXd unit(std::ssize(first));
    for (Index g = 0; g < unit.size(); ++g) {
        const Index i = first[static_cast<std::size_t>(g)];
        unit[g] = unit_[i] / noise_->usual.deviation[i];
    }
    return unit;
}

VectorXd ShootingResidual::matching_sd(const VectorXd& scales) const {
    const VectorXd own = scales.tail(scales.size() - static_cast<Index>(reading_groups()));
    if (!noise_) return own;
    VectorXd sd(noise_->usual.deviation.size());
    for (std::size_t g = 0; g < noise_->chains.size(); ++g)
        for (const Index i : noise_->chains[g].coordinates)
            sd[i] = own[static_cast<Index>(g)] * noise_->usual.deviation[i];
    return sd;
}

/// Groups and known sds of the linked records of a block, which end it.
void ShootingResidual::set_link_errors(std::size_t node, estimator::BlockLayout& block) const {
    const auto before = std::ssize(block.group);
    const VectorXd& deviation = noise_->links[data_->plan.nodes[node].pattern].deviation;
    block.group.resize(static_cast<std::size_t>(before + deviation.size()));
    for (std::size_t g = 0; g < noise_->chains.size(); ++g)
        for (const Index i : noise_->chains[g].coordinates)
            block.group[static_cast<std::size_t>(before + i)] = static_cast<int>(reading_groups() + g);
    block.deviation = VectorXd::Ones(before + deviation.size());
    block.deviation.tail(deviation.size()) = deviation;
}

/// Links as independent errors.
void ShootingResidual::whiten(std::size_t pattern, estimator::BlockValue& value) const {
    const MatrixXd& unmix = noise_->links[pattern].unmix;
    const Index n = unmix.rows();
    value.e.tail(n) = (unmix * value.e.tail(n)).eval();
    for (MatrixXd* rows : {&value.e_theta, &value.e_z, &value.e_next})
        if (rows->size() > 0) rows->bottomRows(n) = (unmix * rows->bottomRows(n)).eval();
}

/// Scales of readings that are still to be estimated, from their residuals. While matching is loose, nodes take as many
/// readings as they have coordinates.
void ShootingResidual::read_scales(estimator::ActiveSet& active, const VectorXd& theta,
                                   const std::vector<VectorXd>& latents, bool loose) const {
    constexpr double least_freedom = 0.2;  // of the readings: fewer tell no scale
    std::vector<std::vector<double>> sizes(data_->reading_range.size());
    const auto values = evaluate(active, theta, latents, false);
    for (std::size_t b = 0; b < values.size(); ++b) {
        if (!active.layout[b].active || values[b].status != estimator::BlockStatus::ok) continue;
        const auto readings = data_->plan.of(b);
        for (std::size_t r = 0; r < readings.size(); ++r)
            sizes[static_cast<std::size_t>(readings[r].group)].push_back(std::abs(values[b].e[static_cast<Index>(r)]) /
                                                                         readings[r].deviation);
    }
    double readings = 0.0;
    for (const auto& of_group : sizes)
        readings += static_cast<double>(of_group.size());
    const double nodes = static_cast<double>(values.size()) * static_cast<double>(data_->system().dimension());
    const double freedom = readings > 0.0 ? 1.0 - nodes / readings : 0.0;
    for (std::size_t g = 0; g < sizes.size(); ++g) {
        estimator::Group& group = active.groups[g];
        if (!group.scale.estimate || sizes[g].empty()) continue;
        const double told = normal_median * models::upper_median(std::move(sizes[g]));
        if (!loose)
            group.scale.value = std::max(group.floor, told);
        else if (freedom > least_freedom)
            group.scale.value = std::max(group.floor, std::min(group.scale.value, told / std::sqrt(freedom)));
    }
}

ShootingResidual::Defect ShootingResidual::defect(const estimator::ActiveSet& active, const VectorXd& theta,
                                                  const std::vector<VectorXd>& latents, const VectorXd& sd) const {
    const VectorXd limit = 3.0 * (sd.size() > 0 ? sd : matching_sd(active));
    const Index n = data_->system().dimension();
    Defect result{VectorXd::Zero(n), VectorXd::Zero(n), 0, 0};
    std::vector<std::vector<double>> sizes(static_cast<std::size_t>(n));
    const auto values = evaluate(active, theta, latents, false);
    for (std::size_t b = 0; b < values.size(); ++b) {
        if (!active.layout[b].active || !data_->plan.nodes[b].linked || !active.layout[b + 1].active ||
            values[b].status != estimator::BlockStatus::ok)
            continue;
        VectorXd d = matching_.constraints ? values[b].c : VectorXd(values[b].e.tail(n));
        if (noise_)  // as if all intervals had the usual duration
            d.array() *=
                noise_->usual.deviation.array() / noise_->links[data_->plan.nodes[b].pattern].deviation.array();
        ++result.count;
        if ((d.array().abs() > limit.array()).any()) ++result.large;
        result.rms += d.cwiseAbs2();
        for (Index i = 0; i < n; ++i)
            sizes[static_cast<std::size_t>(i)].push_back(std::abs(d[i]));
    }
    result.rms = (result.rms / static_cast<double>(std::max<std::size_t>(result.count, 1))).cwiseSqrt();
    for (Index i = 0; i < n; ++i)
        result.typical[i] = normal_median * models::upper_median(std::move(sizes[static_cast<std::size_t>(i)]));
    return result;
}

}  // namespace orbid::orbits
