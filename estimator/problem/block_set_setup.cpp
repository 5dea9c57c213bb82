#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "estimator/problem/block_set.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

[[noreturn]] void refuse_block(const BlockLayout& from, const std::string& what) {
    throw std::invalid_argument("residual block \"" + from.label + "\": " + what);
}

/// Sorts the records [begin, end) of a block by law.
std::vector<LawPart> parts_of(const BlockRecords& records, const BlockLayout& from, const std::vector<NoiseModel>& laws,
                              std::size_t begin, std::size_t end) {
    std::vector<LawPart> parts;
    for (std::size_t l = 0; l < laws.size(); ++l) {
        const NoiseModel& law = laws[l];
        LawPart part{l, {}, {}};
        std::size_t first = 0;
        for (const int channel : law.channels) {
            const std::size_t before = part.records.size();
            for (std::size_t i = begin; i < end; ++i)
                if (records.channel[i] == channel) part.records.push_back(static_cast<Eigen::Index>(i));
            const std::size_t own = part.records.size() - before;
            if (channel == law.channels.front()) first = own;
            if (own != first)
                refuse_block(from, "the responses of a full covariance must have the same number of records, not " +
                                       std::to_string(first) + " and " + std::to_string(own));
        }
        if (part.records.empty()) continue;
        if (law.needs_observed()) {
            if (from.observed.size() != static_cast<Eigen::Index>(records.channel.size()))
                refuse_block(from, "log-normal and relative errors need the observed value of every record");
            if (from.deviation.size() > 0) refuse_block(from, "known sds do not go with log-normal or relative errors");
            part.observed.resize(static_cast<Eigen::Index>(part.records.size()));
            for (std::size_t i = 0; i < part.records.size(); ++i) {
                const double y = from.observed[part.records[i]];
                if (!std::isfinite(y) || (std::holds_alternative<LogNormalErrors>(law.distribution) && !(y > 0.0)))
                    refuse_block(from, "observed value " + std::to_string(y) + " of record " +
                                           std::to_string(part.records[i]) +
                                           " must be finite, and positive for log-normal errors");
                part.observed[static_cast<Eigen::Index>(i)] = y;
            }
        }
        parts.push_back(std::move(part));
    }
    return parts;
}

/// Whether a block takes part: inactive ones, and those without records and states, do not.
bool takes_part(const BlockLayout& block) {
    return block.active && !(block.group.empty() && block.latents == 0);
}

/// The first linked record of a block; its number of records when there is none.
std::size_t first_linked(const BlockLayout& from) {
    return from.linked_from < 0 ? from.group.size() : static_cast<std::size_t>(from.linked_from);
}

void check_links(const BlockLayout& from, LatentStructure structure, std::size_t blocks) {
    const bool links = first_linked(from) < from.group.size();
    if (structure == LatentStructure::none && (from.latents > 0 || from.constraints > 0))
        refuse_block(from, "has latent states, but its residual says it has none");
    if (from.linked_from > static_cast<std::ptrdiff_t>(from.group.size()))
        refuse_block(from, "linked_from = " + std::to_string(from.linked_from) + " is beyond its " +
                               std::to_string(from.group.size()) + " records");
    if (links && structure != LatentStructure::chain && structure != LatentStructure::cyclic_chain)
        refuse_block(from, "has records linked to the next block, but its residual is no chain");
    if (links && from.next < 0) refuse_block(from, "has records linked to the next block, but `next` names none");
    if (links && from.shape.size() > 0)
        refuse_block(from, "has both linked records and a covariance shape: give one of them");
    if ((links || from.constraints > 0) && from.next >= static_cast<std::ptrdiff_t>(blocks))
        refuse_block(from, "its next block " + std::to_string(from.next) + " does not exist, there are " +
                               std::to_string(blocks));
}

/// How the records of a law may depend on latent states: all of them alike, for their scale is one.
enum class Place : char { nowhere, own, linked };

void check_places(const BlockRecords& records, const BlockLayout& from, std::vector<Place>& place) {
    const auto check = [&](const LawPart& part, Place here) {
        if (place[part.law] != Place::nowhere && place[part.law] != here)
            refuse_block(from,
                         "records linked to the next block share a group, or a full covariance, with records that "
                         "are not");
        place[part.law] = here;
    };
    for (const LawPart& part : records.parts)
        check(part, Place::own);
    for (const LawPart& part : records.linked_parts)
        check(part, Place::linked);
}

/// Makes the records of blocks. What was made last for blocks with and without linked records is used again.
class RecordSorter {
public:
    /// @param groups  of the residual; the first one is channel `first_channel`.
    RecordSorter(const std::vector<NoiseModel>& laws, int groups, int first_channel, std::vector<Place>& places)
        : laws_(laws), groups_(groups), first_channel_(first_channel), places_(places) {
        needs_observed_ =
            std::any_of(laws.begin(), laws.end(), [](const NoiseModel& law) { return law.needs_observed(); });
    }

    /// @param joined  linked records count.
    std::shared_ptr<const BlockRecords> of(const BlockLayout& from, bool joined) {
        Made& last = made_[joined ? 1 : 0];
        if (last.records == nullptr || needs_observed_ || from.shape.size() > 0 || last.shaped ||
            last.group != from.group || last.linked != first_linked(from))
            last = {from.group, first_linked(from), from.shape.size() > 0, made(from, joined)};
        return last.records;
    }

private:
    /// Records, and what they were made from.
    struct Made {
        std::vector<int> group;
        std::size_t linked = 0;
        bool shaped = false;
        std::shared_ptr<const BlockRecords> records;
    };

    [[nodiscard]] std::shared_ptr<const BlockRecords> made(const BlockLayout& from, bool joined) const {
        BlockRecords records;
        const std::size_t linked = first_linked(from);
        records.channel.reserve(from.group.size());
        for (const int g : from.group) {
            if (g < 0 || g >= groups_)
                refuse_block(from,
                             "group " + std::to_string(g) + " does not exist, there are " + std::to_string(groups_));
            records.channel.push_back(records.channel.size() < linked || joined ? first_channel_ + g : -1);
        }
        if (from.shape.size() == 0) {
            records.parts = parts_of(records, from, laws_, 0, linked);
            if (joined) records.linked_parts = parts_of(records, from, laws_, linked, from.group.size());
            check_places(records, from, places_);
        }
        return std::make_shared<const BlockRecords>(std::move(records));
    }

    const std::vector<NoiseModel>& laws_;
    int groups_;
    int first_channel_;
    std::vector<Place>& places_;
    bool needs_observed_ = false;
    std::array<Made, 2> made_;
};

void count_records(const ActiveBlock& block, BlockSet& set) {
    for (const int c : block.channel()) {
        if (c < 0) continue;
        set.count[c] += 1.0;
        ++set.records;
    }
}

void take_deviations(const BlockLayout& from, ActiveBlock& block, BlockSet& set) {
    const auto records = static_cast<Eigen::Index>(from.group.size());
    if (from.deviation.size() != records || !(from.deviation.array() > 0.0).all() || !from.deviation.allFinite())
        refuse_block(
            from, "known sds must be positive and finite, one for each of the " + std::to_string(records) + " records");
    if (from.shape.size() > 0) refuse_block(from, "has both known sds and a covariance shape: give one of them");
    block.deviation = from.deviation;
    for (Eigen::Index i = 0; i < records; ++i)
        if (block.channel()[static_cast<std::size_t>(i)] >= 0) set.ln_det_shapes += 2.0 * std::log(from.deviation[i]);
}

void take_shape(const BlockLayout& from, const std::vector<const NoiseModel*>& law_of, ActiveBlock& block,
                BlockSet& set) {
    const auto records = static_cast<Eigen::Index>(from.group.size());
    if (from.shape.rows() != records || from.shape.cols() != records)
        refuse_block(from, "covariance shape must be " + std::to_string(records) + " x " + std::to_string(records));
    const models::CholeskyFactor factor(from.shape);
    // A computed covariance is symmetric up to rounding.
    const double largest = from.shape.diagonal().cwiseAbs().maxCoeff();
    const bool symmetric = (from.shape - from.shape.transpose()).cwiseAbs().maxCoeff() <= 1e-12 * largest;
    if (!factor.positive_definite() || !symmetric || !from.shape.allFinite())
        refuse_block(from, "covariance shape must be symmetric and positive definite");
    block.cholesky = factor.lower();
    set.ln_det_shapes += 2.0 * block.cholesky.diagonal().array().log().sum();
    for (const int c : block.channel()) {
        const NoiseModel* law = law_of[static_cast<std::size_t>(c)];
        if (law->joint() || !std::holds_alternative<NormalErrors>(law->distribution))
            refuse_block(from, "a covariance shape needs normal errors in all its groups");
    }
}

void take_constraints(const BlockLayout& from, ActiveBlock& block) {
    block.constraints = from.constraints;
    block.next = from.next;
    block.constraint_size = from.constraint_size;
    if (block.constraint_size.size() == 0) block.constraint_size = Eigen::VectorXd::Ones(from.constraints);
    if (block.constraint_size.size() != from.constraints || !(block.constraint_size.array() > 0.0).all())
        refuse_block(from, "constraint sizes must be positive, one for each of the " +
                               std::to_string(from.constraints) + " constraints");
}

}  // namespace

std::vector<Channel> channels_of(const std::vector<const Residual*>& residuals) {
    std::vector<Channel> channels;
    for (std::size_t r = 0; r < residuals.size(); ++r)
        for (std::size_t g = 0; g < residuals[r]->groups().size(); ++g)
            channels.push_back({r, static_cast<int>(g)});
    return channels;
}

std::vector<ActiveSet> initial_sets(const std::vector<const Residual*>& residuals) {
    std::vector<ActiveSet> active;
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        if (residuals[r] == nullptr) throw std::invalid_argument("residuals[" + std::to_string(r) + "] is null");
        active.push_back(residuals[r]->initial_set());
    }
    return active;
}

const std::string& label_of(const BlockSet& set, const ActiveBlock& block) {
    return set.active[block.residual].layout[block.block].label;
}

BlockSet freeze(const std::vector<const Residual*>& residuals, std::vector<ActiveSet> active,
                const std::vector<Channel>& channels, const std::vector<NoiseModel>& laws) {
    BlockSet set;
    set.active = std::move(active);
    set.count = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(channels.size()));
    std::vector<const NoiseModel*> law_of(channels.size(), nullptr);
    for (const NoiseModel& law : laws)
        for (const int channel : law.channels)
            law_of[static_cast<std::size_t>(channel)] = &law;
    std::vector<Place> places(laws.size(), Place::nowhere);
    int first_channel = 0;
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        const auto& layout = set.active[r].layout;
        const auto groups = static_cast<int>(set.active[r].groups.size());
        const LatentStructure structure = residuals[r]->structure();
        set.provisional = set.provisional || set.active[r].is_intermediate_stage;
        const std::size_t first_block = set.blocks.size();
        set.blocks.reserve(first_block + layout.size());
        std::vector<std::ptrdiff_t> place(layout.size(), -1);
        RecordSorter sorter(laws, groups, first_channel, places);
        for (std::size_t b = 0; b < layout.size(); ++b) {
            const BlockLayout& from = layout[b];
            if (!takes_part(from)) continue;
            check_links(from, structure, layout.size());
            ActiveBlock block;
            block.residual = r;
            block.block = b;
            block.latents = from.latents;
            const bool joined = from.next >= 0 && takes_part(layout[static_cast<std::size_t>(from.next)]);
            block.records = sorter.of(from, joined);
            count_records(block, set);
            if (from.deviation.size() > 0) take_deviations(from, block, set);
            if (from.shape.size() > 0) take_shape(from, law_of, block, set);
            if (!block.linked_parts().empty()) {
                block.next = from.next;
                set.linked = true;
            }
            if (from.constraints > 0 && (from.next < 0 || joined)) take_constraints(from, block);
            set.latents += from.latents;
            place[b] = static_cast<std::ptrdiff_t>(set.blocks.size());
            set.blocks.push_back(std::move(block));
        }
        for (std::size_t a = first_block; a < set.blocks.size(); ++a) {
            ActiveBlock& block = set.blocks[a];
            if (block.next >= 0) block.next = place[static_cast<std::size_t>(block.next)];
            set.constraints += block.constraints;
        }
        first_channel += groups;
    }
    set.all_blocks = set.blocks.size();
    return set;
}

}  // namespace orbid::estimator
