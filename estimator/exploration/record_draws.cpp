#include "estimator/exploration/record_draws.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <variant>

#include "estimator/exploration/block_resampling.hpp"
#include "estimator/exploration/unit_error.hpp"
#include "models/arithmetic/cholesky_factor.hpp"
#include "models/definition/wrong_data.hpp"

namespace orbid::estimator {

namespace {

/// Streams of one replicate: 2^12 residuals of 2^12 groups.
constexpr std::uint64_t most_of_a_kind = 4096;

std::uint64_t stream_of(std::size_t replicate, std::size_t residual, std::size_t group) {
    return (replicate * most_of_a_kind + residual) * most_of_a_kind + group;
}

/// An estimated scale that has come down to its floor; the estimator ends there to rounding.
bool at_floor(const Group& group, double scale) {
    constexpr double rounding = 1e-6;
    return group.scale.estimate && group.floor > 0.0 && scale <= group.floor * (1.0 + rounding);
}

double shape_of(const ErrorDistribution& distribution, const EstimatedScale& scale) {
    double value = 0.0;
    if (const auto* student = std::get_if<StudentErrors>(&distribution)) value = student->dof.value;
    if (const auto* relative = std::get_if<RelativeErrors>(&distribution)) value = relative->relative.value;
    if (const auto* chain = std::get_if<AutoregressiveErrors>(&distribution)) value = chain->correlation.value;
    return scale.shape.empty() ? value : scale.shape.front().value;
}

/// Blocks of a residual in chains, each from its first block on.
std::vector<std::vector<std::size_t>> chains_of(const std::vector<BlockLayout>& layout) {
    const auto leads_on = [&](std::size_t b) {
        return layout[b].next >= 0 && layout[static_cast<std::size_t>(layout[b].next)].active;
    };
    std::vector<bool> follows(layout.size(), false);
    for (std::size_t b = 0; b < layout.size(); ++b)
        if (layout[b].active && leads_on(b)) follows[static_cast<std::size_t>(layout[b].next)] = true;
    std::vector<bool> taken(layout.size(), false);
    std::vector<std::vector<std::size_t>> chains;
    const auto take = [&](std::size_t first) {
        auto& chain = chains.emplace_back();
        for (std::size_t b = first; !taken[b]; b = static_cast<std::size_t>(layout[b].next)) {
            taken[b] = true;
            chain.push_back(b);
            if (!leads_on(b)) break;
        }
    };
    for (std::size_t b = 0; b < layout.size(); ++b)
        if (layout[b].active && !follows[b]) take(b);
    for (std::size_t b = 0; b < layout.size(); ++b)  // what is left is a ring
        if (layout[b].active && !taken[b]) take(b);
    return chains;
}

}  // namespace

const char* name(ErrorDraw draw) {
    return draw == ErrorDraw::automatic ? "auto" : draw == ErrorDraw::parametric ? "parametric" : "blocks";
}

RecordDraws::RecordDraws(const std::vector<const Residual*>& residuals, const Estimate& estimate,
                         const RecordDrawOptions& options)
    : seed_(options.seed), kind_(options.kind), added_(options.added) {
    const std::size_t count = residuals.size();
    if (estimate.status == EstimateStatus::failed || estimate.active.size() != count ||
        estimate.residuals.size() != count)
        throw std::invalid_argument("records are drawn from an estimate of the same residuals that has not failed");
    std::size_t channel = 0;
    bool links_err = false;
    bool correlated = false;
    for (std::size_t r = 0; r < count; ++r) {
        Source& source = sources_.emplace_back(source_of(*residuals[r], estimate, r, channel, options.fixed_links_err));
        channel += source.channels.size();
        gather(source);
        links_err = links_err || std::any_of(source.channels.begin(), source.channels.end(), [](const Channel& one) {
                        return one.linked && !one.exact && !one.sequences.empty();
                    });
        correlated = correlated || is_correlated(source);
    }
    if (kind_ == ErrorDraw::blocks && links_err)
        throw models::DataError(
            "errors cannot be drawn in blocks where the nodes are matched with errors: nodes take "
            "up errors of readings, whose residuals are too small; draw parametric ones, or match "
            "exactly");
    if (kind_ == ErrorDraw::automatic) kind_ = correlated && !links_err ? ErrorDraw::blocks : ErrorDraw::parametric;
}

RecordDraws::Source RecordDraws::source_of(const Residual& residual, const Estimate& estimate, std::size_t index,
                                           std::size_t first_channel, bool fixed_links_err) const {
    Source source;
    const ActiveSet& active = estimate.active[index];
    source.active = &active;
    for (const BlockValue& value : estimate.residuals[index])
        source.fitted.push_back(value.e);
    source.shape_roots.resize(active.layout.size());
    for (std::size_t b = 0; b < active.layout.size(); ++b)
        if (active.layout[b].active && active.layout[b].shape.size() > 0)
            source.shape_roots[b] = models::CholeskyFactor(active.layout[b].shape).lower();
    for (std::size_t g = 0; g < active.groups.size(); ++g) {
        const Group& group = active.groups[g];
        const EstimatedScale& scale = estimate.scales[first_channel + g];
        Channel& channel = source.channels.emplace_back();
        channel.distribution = group.distribution;
        channel.scale = scale.value;
        channel.shape = shape_of(group.distribution, scale);
        channel.ordered = group.ordered;
        const bool slack = group.scale.estimate ? at_floor(group, scale.value) : !fixed_links_err;
        channel.exact = slack;  // of linked groups alone, see gather()
    }
    for (const JointCovariance& covariance : residual.covariances()) {
        const auto m = static_cast<Eigen::Index>(covariance.groups.size());
        const auto found =
            std::find_if(estimate.covariances.begin(), estimate.covariances.end(), [&](const EstimatedCovariance& one) {
                return one.groups.front() == active.groups[static_cast<std::size_t>(covariance.groups[0])].name;
            });
        if (found == estimate.covariances.end() || found->value.rows() != m) continue;
        Eigen::MatrixXd root = models::CholeskyFactor(found->value).lower();
        for (Eigen::Index i = 0; i < m; ++i)
            root.row(i) /=
                source.channels[static_cast<std::size_t>(covariance.groups[static_cast<std::size_t>(i)])].scale;
        source.joint.emplace_back(covariance.groups, std::move(root));
    }
    return source;
}

/// Sequences of records by group, and the errors that are drawn from.
void RecordDraws::gather(Source& source) {
    const auto& layout = source.active->layout;
    for (const auto& chain : chains_of(layout)) {
        for (Channel& channel : source.channels)
            channel.sequences.emplace_back();
        for (const std::size_t b : chain) {
            const BlockLayout& block = layout[b];
            for (std::size_t i = 0; i < block.group.size(); ++i) {
                Channel& channel = source.channels[static_cast<std::size_t>(block.group[i])];
                channel.sequences.back().push_back({b, static_cast<Eigen::Index>(i)});
                channel.linked =
                    channel.linked || (block.linked_from >= 0 && std::ssize(block.group) > block.linked_from &&
                                       static_cast<std::ptrdiff_t>(i) >= block.linked_from);
            }
        }
        for (Channel& channel : source.channels)
            if (channel.sequences.back().empty()) channel.sequences.pop_back();
    }
    for (Channel& channel : source.channels) {
        channel.exact = channel.exact && channel.linked;
        const auto all = sequences(source, channel);
        for (const auto& sequence : all)
            channel.pool.insert(channel.pool.end(), sequence.begin(), sequence.end());
        if (has_unit_square(channel.distribution) && !channel.pool.empty() && !standardise(channel.pool))
            std::fill(channel.pool.begin(), channel.pool.end(), 0.0);
        if (channel.ordered && !channel.exact) source.length = std::max(source.length, block_length(all));
    }
}

/// In the unit of the record; relative errors are those of the prediction.
double RecordDraws::local_sd(const Source& source, const Channel& channel, std::size_t block, Eigen::Index record) {
    const BlockLayout& layout = source.active->layout[block];
    const double known = layout.deviation.size() > 0 ? layout.deviation[record] : 1.0;
    if (!std::holds_alternative<RelativeErrors>(channel.distribution)) return channel.scale * known;
    const double prediction = layout.observed[record] - source.fitted[block][record];
    return known * std::hypot(channel.scale, channel.shape * prediction);
}

/// Errors of a block at the estimate, each over its sd; correlations of a covariance shape are taken off.
Eigen::VectorXd RecordDraws::units(const Source& source, std::size_t block) {
    const BlockLayout& layout = source.active->layout[block];
    Eigen::VectorXd unit = source.fitted[block];
    for (Eigen::Index i = 0; i < unit.size(); ++i) {
        const Channel& channel = source.channels[static_cast<std::size_t>(layout.group[static_cast<std::size_t>(i)])];
        if (std::holds_alternative<LogNormalErrors>(channel.distribution))
            unit[i] = -std::log1p(-unit[i] / layout.observed[i]) / channel.scale;
        else
            unit[i] /= local_sd(source, channel, block, i);
    }
    if (source.shape_roots[block].size() > 0)
        source.shape_roots[block].triangularView<Eigen::Lower>().solveInPlace(unit);
    return unit;
}

std::vector<std::vector<double>> RecordDraws::sequences(const Source& source, const Channel& channel) {
    std::vector<std::vector<double>> all;
    for (const auto& sequence : channel.sequences) {
        auto& errors = all.emplace_back();
        std::size_t block = sequence.front().block;
        Eigen::VectorXd unit = units(source, block);
        for (const Place& place : sequence) {
            if (place.block != block) unit = units(source, block = place.block);
            errors.push_back(unit[place.record]);
        }
    }
    return all;
}

/// Beyond what the error law says: of an autoregression, its innovations.
bool RecordDraws::is_correlated(const Source& source) {
    return std::any_of(source.channels.begin(), source.channels.end(), [&](const Channel& channel) {
        if (!channel.ordered || channel.exact) return false;
        auto all = sequences(source, channel);
        if (std::holds_alternative<AutoregressiveErrors>(channel.distribution))
            for (auto& errors : all)
                for (std::size_t i = errors.size(); i-- > 1;)
                    errors[i] -= channel.shape * errors[i - 1];
        return block_length(all) > 1;
    });
}

std::size_t RecordDraws::longest_block() const {
    std::size_t longest = 1;
    for (const Source& source : sources_)
        longest = std::max(longest, source.length);
    return longest;
}

void RecordDraws::draw(const Channel& channel, std::size_t length, RandomStream random,
                       std::vector<Eigen::VectorXd>& unit) const {
    if (kind_ == ErrorDraw::blocks) {
        if (channel.pool.empty()) return;
        const auto drawn = drawn_blocks(channel.pool.size(), channel.pool.size(), channel.ordered ? length : 1, random);
        std::size_t next = 0;
        for (const auto& sequence : channel.sequences)
            for (const Place& place : sequence)
                unit[place.block][place.record] = channel.pool[drawn[next++]];
        return;
    }
    for (const auto& sequence : channel.sequences) {
        const Place* last = nullptr;
        for (const Place& place : sequence) {
            const bool goes_on = last != nullptr && last->block == place.block;
            const double* before = goes_on ? &unit[last->block][last->record] : nullptr;
            unit[place.block][place.record] = unit_error(channel.distribution, channel.shape, before, random);
            last = &place;
        }
    }
}

std::vector<std::vector<Eigen::VectorXd>> RecordDraws::shifts(std::size_t replicate, Mirror mirror) const {
    std::vector<std::vector<Eigen::VectorXd>> all;
    for (std::size_t r = 0; r < sources_.size(); ++r) {
        const Source& source = sources_[r];
        const auto& layout = source.active->layout;
        std::vector<Eigen::VectorXd> unit(layout.size());
        for (std::size_t b = 0; b < layout.size(); ++b)
            if (layout[b].active) unit[b] = Eigen::VectorXd::Zero(source.fitted[b].size());
        for (std::size_t g = 0; g < source.channels.size(); ++g) {
            if (source.channels[g].exact) continue;
            // Blocks of all groups begin at the same places: what errs together stays together.
            const std::size_t own = kind_ == ErrorDraw::blocks && source.channels[g].ordered ? most_of_a_kind - 1 : g;
            draw(source.channels[g], source.length, {seed_, RandomPurpose::bootstrap, stream_of(replicate, r, own)},
                 unit);
        }
        if (mirror == Mirror::opposite)
            for (Eigen::VectorXd& one : unit)
                one = -one;
        auto& shifts = all.emplace_back(layout.size());
        for (std::size_t b = 0; b < layout.size(); ++b) {
            if (!layout[b].active) continue;
            if (kind_ == ErrorDraw::parametric) couple(source, b, unit[b]);
            if (source.shape_roots[b].size() > 0)
                unit[b] = (source.shape_roots[b].triangularView<Eigen::Lower>() * unit[b]).eval();
            shifts[b] = shift_of(source, b, unit[b]);
        }
    }
    return all;
}

/// Independent errors become those of full covariances.
void RecordDraws::couple(const Source& source, std::size_t block, Eigen::VectorXd& unit) {
    const auto& group = source.active->layout[block].group;
    for (const auto& [groups, root] : source.joint) {
        const Eigen::Index m = root.rows();
        std::vector<std::vector<Eigen::Index>> records(static_cast<std::size_t>(m));
        for (std::size_t i = 0; i < group.size(); ++i)
            for (std::size_t k = 0; k < groups.size(); ++k)
                if (groups[k] == group[i]) records[k].push_back(static_cast<Eigen::Index>(i));
        Eigen::VectorXd together(m);
        for (std::size_t n = 0; n < records.front().size(); ++n) {
            for (std::size_t k = 0; k < records.size(); ++k)
                together[static_cast<Eigen::Index>(k)] = unit[records[k][n]];
            together = (root.triangularView<Eigen::Lower>() * together).eval();
            for (std::size_t k = 0; k < records.size(); ++k)
                unit[records[k][n]] = together[static_cast<Eigen::Index>(k)];
        }
    }
}

Eigen::VectorXd RecordDraws::shift_of(const Source& source, std::size_t block, const Eigen::VectorXd& unit) const {
    const BlockLayout& layout = source.active->layout[block];
    const double share = added() ? std::sqrt(added_) : 1.0;
    Eigen::VectorXd shift = added() ? Eigen::VectorXd::Zero(unit.size()) : Eigen::VectorXd(-source.fitted[block]);
    for (Eigen::Index i = 0; i < shift.size(); ++i) {
        const Channel& channel = source.channels[static_cast<std::size_t>(layout.group[static_cast<std::size_t>(i)])];
        if (std::holds_alternative<LogNormalErrors>(channel.distribution))
            shift[i] += (layout.observed[i] + shift[i]) * std::expm1(share * channel.scale * unit[i]);
        else
            shift[i] += share * local_sd(source, channel, block, i) * unit[i];
    }
    return shift;
}

}  // namespace orbid::estimator
