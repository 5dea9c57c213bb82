#include "orbits/cycles/cycle_waveform.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "orbits/local_maps/local_polynomial.hpp"
#include "orbits/local_maps/monomials.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"
#include "orbits/sections/time_smoothing.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;

/// Readings per return to the section: as many as samples, within these.
constexpr Index fewest_places = 8, most_places = 64;
/// Sizes of neighbourhoods that are tried, in numbers of coefficients.
constexpr std::array<std::size_t, 4> passage_counts{3, 6, 12, 24};
/// The polynomials' weights are 0 at this multiple of the farthest neighbour's distance.
constexpr double beyond_farthest = 1.05;
/// Sds never fall below this share of the range.
constexpr double rounding_share = 1e-9;
/// A reading that is better known than this share of the waveform's typical sd is told by the section itself.
constexpr double pinned_share = 1e-3;
/// Samples among which the windows of smoothing are chosen.
constexpr Index most_marks = 2000;

/// The origin of a point of the section in the record.
struct Origin {
    std::size_t segment = 0;
    double time = 0.0;
};

/// The origins of all points in order. Pieces of a segment are named after it: "0", "0.1", "0.2".
std::vector<Origin> origins_of(const Series& samples, const Series& section) {
    std::vector<Origin> origins;
    for (const Segment& piece : section.segments) {
        std::size_t own = samples.segments.size();
        std::size_t length = 0;
        for (std::size_t s = 0; s < samples.segments.size(); ++s) {
            const std::string& label = samples.segments[s].label;
            const bool named = piece.label == label || piece.label.starts_with(label + ".");
            if (!named || (own < samples.segments.size() && label.size() <= length)) continue;
            own = s;
            length = label.size();
        }
        refuse_if(own == samples.segments.size(), "cycle_waveforms: the piece {} of the section is of no segment",
                  piece.label);
        for (const double time : piece.times)
            origins.push_back({own, time});
    }
    return origins;
}

class WaveformReader {
public:
    WaveformReader(const Series& samples, std::span<const Index> coordinates, const Series& section,
                   const std::function<bool()>& interrupted)
        : samples_(samples),
          coordinates_(coordinates),
          points_(section, std::nullopt, {}, interrupted),
          index_(points_),
          origins_(origins_of(samples, section)),
          step_(sampling_interval(samples, "cycle_waveforms")),
          range_(samples.scale()) {
        std::vector<std::vector<Index>> marks;
        for (const Segment& segment : samples.segments) {
            std::vector<Index>& own = marks.emplace_back();
            const Index count = segment.values.cols();
            for (Index k = 0; k + 1 < count; k += std::max<Index>(1, count / most_marks))
                own.push_back(k);
        }
        const auto places = places_near(marks);
        for (const Index c : coordinates) {
            const TimeWindow window = best_window(samples, c, places, interrupted);
            auto& own = smoothings_.emplace_back();
            for (const Segment& segment : samples.segments)
                own.emplace_back(segment, c, samples.coordinate(c).angle, step_, window);
        }
    }

    std::optional<CycleWaveform> read(const Cycle& cycle, std::size_t number) const {
        CycleWaveform waveform{number, cycle.period, 0.0, 0.0, {}, {}, {}};
        double variance = 0.0;
        for (Index j = 0; j < cycle.points.cols(); ++j) {
            points_.stop_if_asked();
            const auto piece = piece_from(cycle.points.col(j).cwiseQuotient(points_.scale()), covariance_of(cycle, j));
            if (!piece) return std::nullopt;
            append(*piece, waveform);
            variance += piece->return_sd * piece->return_sd;
        }
        waveform.time_sd = std::sqrt(variance);
        leave_out_pinned(waveform);
        return waveform;
    }

private:
    /// Covariance of point j of a cycle in scaled units; 0 where it is not known.
    [[nodiscard]] Eigen::MatrixXd covariance_of(const Cycle& cycle, Index j) const {
        const Index n = points_.dimension();
        if (cycle.covariance.rows() != n * cycle.points.cols()) return Eigen::MatrixXd::Zero(n, n);
        const Eigen::VectorXd unit = points_.scale().cwiseInverse();
        return unit.asDiagonal() * cycle.covariance.block(j * n, j * n, n, n) * unit.asDiagonal();
    }

    /// The readings from one point of a cycle to the next.
    struct Piece {
        double return_time = 0.0;
        double return_sd = 0.0;
        Eigen::MatrixXd values, deviations;  ///< shape (c, places)
    };

    static void append(const Piece& piece, CycleWaveform& waveform) {
        const Index before = waveform.times.size(), more = piece.values.cols();
        waveform.times.conservativeResize(before + more);
        for (Index k = 0; k < more; ++k)
            waveform.times[before + k] =
                waveform.time + piece.return_time * static_cast<double>(k) / static_cast<double>(more);
        waveform.values.conservativeResize(piece.values.rows(), before + more);
        waveform.deviations.conservativeResize(piece.values.rows(), before + more);
        waveform.values.rightCols(more) = piece.values;
        waveform.deviations.rightCols(more) = piece.deviations;
        waveform.time += piece.return_time;
    }

    /// At a crossing the plane's own coordinate has the plane's value: that is no reading.
    static void leave_out_pinned(CycleWaveform& waveform) {
        for (Index c = 0; c < waveform.values.rows(); ++c) {
            const double typical =
                std::sqrt(waveform.deviations.row(c).squaredNorm() / static_cast<double>(waveform.deviations.cols()));
            for (Index k = 0; k < waveform.values.cols(); ++k)
                if (waveform.deviations(c, k) < pinned_share * typical)
                    waveform.values(c, k) = std::numeric_limits<double>::quiet_NaN();
        }
    }

    /// What is read in `places` equal shares of the way from a point of the section to its image, then the return time;
    /// empty where the record has a hole.
    [[nodiscard]] Eigen::VectorXd passage(std::size_t point, Index places) const {
        const Origin& from = origins_[point];
        const double time = origins_[point + 1].time - from.time;
        const Eigen::VectorXd& times = samples_.segments[from.segment].times;
        Eigen::VectorXd row(places * std::ssize(coordinates_) + 1);
        for (std::size_t c = 0; c < coordinates_.size(); ++c)
            for (Index k = 0; k < places; ++k) {
                const double at =
                    (from.time + time * static_cast<double>(k) / static_cast<double>(places) - times[0]) / step_;
                const Index sample = std::clamp<Index>(static_cast<Index>(std::floor(at)), 0, times.size() - 2);
                const SmoothedValue value = smoothings_[c][from.segment].at(sample, at - static_cast<double>(sample));
                if (!value.reliable()) return {};
                row[static_cast<Index>(c) * places + k] = value.value;
            }
        row[row.size() - 1] = time;
        return row;
    }

    /// @param covariance  of the place, which is a point of the cycle
    [[nodiscard]] std::optional<Piece> piece_from(const Eigen::VectorXd& place,
                                                  const Eigen::MatrixXd& covariance) const {
        const Index n = points_.dimension();
        const std::size_t most = std::min(passage_counts.back() * static_cast<std::size_t>(coefficient_count(n, 2)),
                                          points_.image_count() / 2);
        Index places = 0;
        std::vector<Eigen::VectorXd> rows, offsets;
        std::vector<double> distances;
        for (const Neighbour& near : index_.nearest(place, most)) {
            if (places == 0)
                places =
                    std::clamp<Index>(std::lround((origins_[near.index + 1].time - origins_[near.index].time) / step_),
                                      fewest_places, most_places);
            Eigen::VectorXd row = passage(near.index, places);
            if (row.size() == 0) continue;
            rows.push_back(std::move(row));
            offsets.push_back(
                points_.difference(Eigen::Map<const Eigen::VectorXd>(points_.point(near.index), n), place));
            distances.push_back(std::sqrt(near.distance2));
        }
        return fitted(rows, offsets, distances, covariance);
    }

    [[nodiscard]] std::optional<Piece> fitted(const std::vector<Eigen::VectorXd>& rows,
                                              const std::vector<Eigen::VectorXd>& offsets,
                                              const std::vector<double>& distances,
                                              const Eigen::MatrixXd& covariance) const {
        const Index n = points_.dimension();
        std::optional<LocalPolynomial> best;
        double least = std::numeric_limits<double>::infinity();
        for (const int order : {1, 2})
            for (const std::size_t count : passage_counts) {
                const std::size_t k = count * static_cast<std::size_t>(coefficient_count(n, order));
                if (k > rows.size()) continue;
                Eigen::MatrixXd places_of(static_cast<Index>(k), n), values(static_cast<Index>(k), rows[0].size());
                for (std::size_t i = 0; i < k; ++i) {
                    places_of.row(static_cast<Index>(i)) = offsets[i].transpose();
                    values.row(static_cast<Index>(i)) = rows[i].transpose();
                }
                LocalPolynomial fit =
                    fit_local_polynomial(places_of, values, beyond_farthest * distances[k - 1], order);
                const double error = fit.residual.diagonal().head(rows[0].size() - 1).sum() * fit.leverage;
                if (!fit.usable || !(error < least)) continue;
                least = error;
                best = std::move(fit);
            }
        if (!best) return std::nullopt;
        const auto sd_of = [&](Index at) {
            return std::sqrt(best->residual(at, at) * best->leverage +
                             best->slope.row(at).dot(covariance * best->slope.row(at).transpose()));
        };
        Piece piece;
        const Index last = best->value.size() - 1;
        const Index places = last / std::ssize(coordinates_);
        piece.return_time = best->value[last];
        piece.return_sd = sd_of(last);
        piece.values.resize(std::ssize(coordinates_), places);
        piece.deviations.resizeLike(piece.values);
        for (Index c = 0; c < piece.values.rows(); ++c) {
            const double floor = rounding_share * range_[coordinates_[static_cast<std::size_t>(c)]];
            for (Index k = 0; k < places; ++k) {
                const Index at = c * places + k;
                piece.values(c, k) = best->value[at];
                piece.deviations(c, k) = std::max(sd_of(at), floor);
            }
        }
        if (!(piece.return_time > 0.0)) return std::nullopt;
        return piece;
    }

    const Series& samples_;
    std::span<const Index> coordinates_;
    SectionPoints points_;
    NeighbourIndex index_;
    std::vector<Origin> origins_;
    double step_;
    Eigen::VectorXd range_;
    std::vector<std::vector<TimeSmoothing>> smoothings_;  ///< by coordinate, segment
};

}  // namespace

std::vector<CycleWaveform> cycle_waveforms(const Series& samples, std::span<const Index> coordinates,
                                           const Series& section, const std::vector<Cycle>& cycles,
                                           const std::function<bool()>& interrupted) {
    check_samples(samples, "cycle_waveforms");
    refuse_if(section.sampling != Series::Sampling::section || !section.timed(),
              "cycle_waveforms: needs a section with times");
    for (const Index c : coordinates) {
        refuse_if(c < 0 || c >= samples.dimension(), "cycle_waveforms: the coordinate must be in [0, {}), got {}",
                  samples.dimension(), c);
        refuse_if(samples.coordinate(c).angle,
                  "cycle_waveforms: '{}' is an angle: its turns along a cycle are not told",
                  samples.coordinate(c).name);
    }
    for (const Cycle& cycle : cycles)
        refuse_if(cycle.points.rows() != section.dimension(),
                  "cycle_waveforms: cycles have {} coordinates, the section {}", cycle.points.rows(),
                  section.dimension());
    std::vector<CycleWaveform> waveforms;
    if (cycles.empty()) return waveforms;
    const WaveformReader reader(samples, coordinates, section, interrupted);
    for (std::size_t i = 0; i < cycles.size(); ++i)
        if (auto waveform = reader.read(cycles[i], i)) waveforms.push_back(std::move(*waveform));
    return waveforms;
}

}  // namespace orbid::orbits
