#include "orbits/cycles/cycle_candidate.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace orbid::orbits {
namespace {

// Two solutions are one cycle when all points lie within this many standard deviations, or within this distance
// (scaled units).
constexpr double same_sds = 6.0;
constexpr double same_candidate_distance = 1e-6;

Cycle plain(const SectionPoints& section, const CycleCandidate& draft) {
    const Eigen::Index n = draft.points.rows(), p = draft.points.cols();
    Cycle cycle;
    cycle.period = static_cast<int>(p);
    cycle.points = section.scale().asDiagonal() * draft.points;
    for (Eigen::Index d = 0; d < n; ++d)
        if (section.is_angle(d))
            for (Eigen::Index j = 0; j < p; ++j)
                if (!(cycle.points(d, j) > -std::numbers::pi)) cycle.points(d, j) += 2.0 * std::numbers::pi;
    const Eigen::VectorXd unit = section.scale().replicate(p, 1);
    cycle.covariance = unit.asDiagonal() * draft.covariance * unit.asDiagonal();
    cycle.multipliers = draft.multipliers.values;
    cycle.ln_multiplier = draft.multipliers.ln_modulus;
    cycle.ln_multiplier_covariance = draft.ln_multiplier_covariance;
    if (draft.common.size() > 0) {
        cycle.common = draft.common;
        cycle.common.topRows(n * p) = unit.asDiagonal() * draft.common.topRows(n * p);
    }
    cycle.time = draft.time;
    cycle.time_sd = draft.time_sd;
    if (draft.time_covariance.size() > 0) cycle.time_covariance = unit.cwiseProduct(draft.time_covariance);
    cycle.recurrences = draft.recurrences;
    for (Eigen::Index a = 0; a < draft.advance.size(); ++a)
        cycle.rotation.push_back(static_cast<int>(draft.advance[a]));
    cycle.quality = draft.quality;
    return cycle;
}

// Mirrored halves of a cycle come from the same data. Together they say what one says: their sum has twice the variance
// of independent halves, and their difference, which is 0, says nothing.
void add_difference_of_halves(const SectionPoints& section, Eigen::Index shift, CycleCandidate& draft) {
    const Eigen::Index n = draft.points.rows(), p = draft.points.cols();
    if (draft.readings.points.empty()) {
        draft.covariance *= 2.0;
        draft.time_covariance *= 2.0;
        draft.time_sd *= std::numbers::sqrt2;
        return;
    }
    Eigen::MatrixXd difference = 0.5 * Eigen::MatrixXd::Identity(n * p, n * p);
    for (Eigen::Index j = 0; j < p; ++j)
        for (Eigen::Index d = 0; d < n; ++d)
            difference(j * n + d, ((j + shift) % p) * n + d) -= 0.5 * section.signs()[d];
    draft.covariance += 2.0 * difference * draft.covariance.diagonal().asDiagonal() * difference.transpose();
}

}  // namespace

double CycleCandidate::largest_sd() const {
    return std::sqrt(covariance.diagonal().maxCoeff());
}

double cycle_distance(const SectionPoints& section, const Eigen::MatrixXd& a, const Eigen::MatrixXd& b,
                      Eigen::Index shift, bool mirrored) {
    const Eigen::Index p = a.cols();
    double largest = 0.0;
    for (Eigen::Index j = 0; j < p; ++j)
        for (Eigen::Index d = 0; d < a.rows(); ++d) {
            const double other = b(d, (j + shift) % p);
            largest = std::max(largest,
                               std::abs(section.difference(a(d, j), mirrored ? section.signs()[d] * other : other, d)));
        }
    return largest;
}

bool same_cycle(const SectionPoints& section, const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, double tolerance) {
    for (Eigen::Index shift = 0; shift < a.cols(); ++shift) {
        if (cycle_distance(section, a, b, shift, false) <= tolerance) return true;
        if (section.symmetric() && cycle_distance(section, a, b, shift, true) <= tolerance) return true;
    }
    return false;
}

bool is_prime(const SectionPoints& section, const Eigen::MatrixXd& points, double tolerance) {
    for (Eigen::Index shift = 1; shift < points.cols(); ++shift)
        if (points.cols() % shift == 0 && cycle_distance(section, points, points, shift, false) <= tolerance)
            return false;
    return true;
}

double same_cycle_tolerance(double sd_a, double sd_b, double limit) {
    return std::min(limit, std::max(same_candidate_distance, same_sds * std::hypot(sd_a, sd_b)));
}

std::vector<CycleCandidate> merged(
    const SectionPoints& section, std::vector<CycleCandidate> drafts,
    const std::function<double(const CycleCandidate&, const CycleCandidate&)>& tolerance_of) {
    std::stable_sort(drafts.begin(), drafts.end(),
                     [](const CycleCandidate& a, const CycleCandidate& b) { return a.recurrences > b.recurrences; });
    std::vector<CycleCandidate> result;
    for (CycleCandidate& draft : drafts) {
        section.stop_if_asked();
        const auto found = std::find_if(result.begin(), result.end(), [&](const CycleCandidate& other) {
            return same_cycle(section, other.points, draft.points, tolerance_of(other, draft));
        });
        if (found == result.end())
            result.push_back(std::move(draft));
        else
            found->recurrences += draft.recurrences;
    }
    std::stable_sort(result.begin(), result.end(),
                     [](const CycleCandidate& a, const CycleCandidate& b) { return a.recurrences > b.recurrences; });
    return result;
}

std::vector<CycleCandidate> merged_by_sds(const SectionPoints& section, std::vector<CycleCandidate> drafts,
                                          double limit) {
    const auto tolerance = [&](const CycleCandidate& a, const CycleCandidate& b) {
        return same_cycle_tolerance(a.largest_sd(), b.largest_sd(), limit);
    };
    drafts = merged(section, std::move(drafts), tolerance);
    std::erase_if(drafts,
                  [&](const CycleCandidate& one) { return !is_prime(section, one.points, tolerance(one, one)); });
    return drafts;
}

std::vector<CycleCandidate> accepted_drafts(std::vector<JudgedCandidate> trials, CycleSearch& search) {
    std::vector<CycleCandidate> drafts;
    for (JudgedCandidate& trial : trials)
        if (trial.accepted)
            drafts.push_back(std::move(trial.draft));
        else
            ++search.rejected;
    return drafts;
}

Eigen::VectorXd count_turns(const SectionPoints& section, const NeighbourIndex& grid, const Eigen::MatrixXd& points) {
    if (!section.turns_known()) return {};
    std::vector<Neighbour> nearest;
    for (Eigen::Index j = 0; j < points.cols(); ++j)
        nearest.push_back(grid.nearest(points.col(j), 1).front());
    std::vector<double> turns;
    for (Eigen::Index d = 0; d < section.dimension(); ++d) {
        if (!section.is_angle(d)) continue;
        // Turns are those of the nearest neighbours, corrected to the cycle's own points.
        double sum = 0.0;
        for (Eigen::Index j = 0; j < points.cols(); ++j) {
            const Neighbour& near = nearest[static_cast<std::size_t>(j)];
            const double sign = near.mirrored ? section.signs()[d] : 1.0;
            const double start = sign * section.point(near.index)[d];
            const double image = sign * section.point(near.index + 1)[d];
            sum += sign * section.advance(near.index, d) +
                   section.difference(points(d, (j + 1) % points.cols()), image, d) -
                   section.difference(points(d, j), start, d);
        }
        turns.push_back(std::nearbyint(sum));
    }
    return Eigen::Map<const Eigen::VectorXd>(turns.data(), static_cast<Eigen::Index>(turns.size()));
}

void publish(const SectionPoints& section, const CycleCandidate& draft, double tolerance, std::vector<Cycle>& cycles) {
    Cycle cycle = plain(section, draft);
    if (!section.symmetric()) {
        cycles.push_back(std::move(cycle));
        return;
    }
    const Eigen::Index p = draft.points.cols();
    const std::size_t own = cycles.size();
    for (Eigen::Index shift = 0; shift < p; ++shift) {
        if (!(cycle_distance(section, draft.points, draft.points, shift, true) <= tolerance)) continue;
        CycleCandidate symmetric = draft;
        for (Eigen::Index j = 0; j < p; ++j) {
            const Eigen::VectorXd here = draft.points.col(j);
            const Eigen::VectorXd mirrored = section.signs().cwiseProduct(draft.points.col((j + shift) % p));
            symmetric.points.col(j) = section.wrapped(here + 0.5 * section.difference(mirrored, here));
        }
        add_difference_of_halves(section, shift, symmetric);
        cycle = plain(section, symmetric);
        cycle.mirror = own;
        cycles.push_back(std::move(cycle));
        return;
    }
    CycleCandidate partner = draft;
    partner.common.resize(0, 0);
    for (Eigen::Index j = 0; j < p; ++j)
        partner.points.col(j) = section.wrapped(section.signs().cwiseProduct(draft.points.col(j)));
    const Eigen::VectorXd signs = section.signs().replicate(p, 1);
    partner.covariance = signs.asDiagonal() * draft.covariance * signs.asDiagonal();
    if (partner.time_covariance.size() > 0) partner.time_covariance = signs.cwiseProduct(draft.time_covariance);
    for (Eigen::Index a = 0, d = 0; d < section.dimension(); ++d)
        if (section.is_angle(d)) {
            if (a < partner.advance.size()) partner.advance[a] *= section.signs()[d];
            ++a;
        }
    Cycle mirror = plain(section, partner);
    cycle.mirror = own + 1;
    mirror.mirror = own;
    cycles.push_back(std::move(cycle));
    cycles.push_back(std::move(mirror));
}

}  // namespace orbid::orbits
