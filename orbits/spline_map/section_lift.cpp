#include "orbits/spline_map/section_lift.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numbers>
#include <queue>
#include <tuple>

#include <tbb/parallel_for.h>

#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::orbits {
namespace {

// Neighbours of a fit, as multiples of its coefficients: few follow the folds of the map, many average the noise.
constexpr std::array<double, 5> crowds{4.0, 6.0, 9.0, 14.0, 21.0};

// Turns of neighbours are chosen anew this often while a fit settles; more changed nothing.
constexpr int fit_rounds = 4;

// Ridge of the fits relative to the spread of the neighbours: curve-like neighbourhoods have no slope across.
constexpr double slope_ridge = 1e-3;

/// The plane through the displacements of an angle around a point: value + slope (x - point), in turns.
struct Plane {
    double value = 0.0;
    Eigen::VectorXd slope;
    double residual = 0.0;
};

constexpr double two_pi = 2.0 * std::numbers::pi;

double fraction(double turns) {
    return turns - std::nearbyint(turns);
}

class Lifter {
public:
    Lifter(const SectionPoints& section, const NeighbourIndex& grid) : section_(section) {
        for (std::size_t i = 0; i < section.size(); ++i)
            if (section.has_image(i)) points_.push_back(i);
        number_.assign(section.size(), 0);
        for (std::size_t k = 0; k < points_.size(); ++k)
            number_[points_[k]] = static_cast<std::uint32_t>(k);
        const auto coefficients = static_cast<double>(section.dimension() + 1);
        crowd_ = std::min(points_.size(), static_cast<std::size_t>(coefficients * crowds.back()));
        neighbours_.resize(points_.size());
        tbb::parallel_for(std::size_t{0}, points_.size(), [&](std::size_t k) {
            const Eigen::Map<const Eigen::VectorXd> place(section_.point(points_[k]), section_.dimension());
            neighbours_[k] = grid.nearest(place, crowd_);
        });
    }

    [[nodiscard]] std::size_t nodes() const { return (section_.symmetric() ? 2 : 1) * points_.size(); }
    [[nodiscard]] const std::vector<std::size_t>& points() const { return points_; }

    // As read: from a point to its image, the short way round.
    [[nodiscard]] double read(std::size_t k, Eigen::Index d) const {
        return section_.difference(section_.point(points_[k] + 1)[d], section_.point(points_[k])[d], d);
    }

    // Turns of every node (points, then mirrored points) for one angle; fits on `crowd` neighbours.
    [[nodiscard]] std::vector<double> lifted(Eigen::Index angle, std::size_t crowd) const {
        const std::size_t count = points_.size(), total = nodes();
        std::vector<Plane> planes(count);
        tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
            section_.stop_if_asked();
            planes[k] = wrapped_plane(k, angle, crowd);
        });

        std::vector<std::size_t> starts(count);
        for (std::size_t k = 0; k < count; ++k)
            starts[k] = k;
        std::sort(starts.begin(), starts.end(), [&](std::size_t a, std::size_t b) {
            return std::tie(planes[a].residual, a) < std::tie(planes[b].residual, b);
        });
        std::vector<double> turns(total, 0.0);  // to be added to the plane's value
        std::vector<char> done(total, 0);
        using Edge = std::tuple<double, std::size_t, std::size_t>;  // cost, from, to
        std::priority_queue<Edge, std::vector<Edge>, std::greater<>> edges;
        const auto grow = [&](std::size_t node) {
            section_.stop_if_asked();
            done[node] = 1;
            for (std::size_t m = 0; m < std::min(crowd, crowd_); ++m) {
                const auto [other, offset] = neighbour(node, m);
                if (done[other]) continue;
                const double gap = std::abs(fraction(step(planes, angle, node, other, offset)));
                edges.emplace(gap + std::max(planes[node % count].residual, planes[other % count].residual), node,
                              other);
            }
        };
        for (const std::size_t start : starts)
            for (std::size_t mirrored = 0; mirrored * count < total; ++mirrored) {
                if (done[start + mirrored * count]) continue;
                grow(start + mirrored * count);
                while (!edges.empty()) {
                    const auto [cost, from, to] = edges.top();
                    edges.pop();
                    if (done[to]) continue;
                    turns[to] = turns[from] + std::nearbyint(step(planes, angle, from, to, offset_of(from, to)));
                    grow(to);
                }
            }
        std::vector<double> result(total);
        for (std::size_t node = 0; node < total; ++node) {
            const double sign = node < count ? 1.0 : section_.signs()[angle];
            const double value = sign * planes[node % count].value + turns[node];
            const double raw = sign * read(node % count, angle);
            result[node] = raw + std::nearbyint(value - raw);
        }
        return result;
    }

    // rms of what linear fits on a moderate number of lifted neighbours leave over.
    [[nodiscard]] double roughness(const std::vector<double>& lifted) const {
        const std::size_t crowd = std::min(crowd_, static_cast<std::size_t>(section_.dimension() + 1) * 6);
        std::vector<double> squares(points_.size());
        tbb::parallel_for(std::size_t{0}, points_.size(), [&](std::size_t k) {
            section_.stop_if_asked();
            Eigen::VectorXd values(static_cast<Eigen::Index>(crowd));
            for (std::size_t m = 0; m < crowd; ++m)
                values[static_cast<Eigen::Index>(m)] = lifted[neighbour(k, m).first] - lifted[k];
            const Plane plane = fitted(k, values);
            squares[k] = plane.residual * plane.residual;
        });
        double sum = 0.0;
        for (const double square : squares)
            sum += square;
        return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, squares.size())));
    }

private:
    // The m-th neighbour of a node as a node, and where it lies.
    [[nodiscard]] std::pair<std::size_t, Eigen::VectorXd> neighbour(std::size_t node, std::size_t m) const {
        const std::size_t count = points_.size();
        const bool flip = node >= count;
        const Neighbour& near = neighbours_[node % count][m];
        const std::size_t other = number_[near.index] + (near.mirrored != flip ? count : 0);
        return {other, offset_of(node, other)};
    }

    [[nodiscard]] Eigen::VectorXd place(std::size_t node) const {
        const Eigen::Map<const Eigen::VectorXd> x(section_.point(points_[node % points_.size()]), section_.dimension());
        if (node < points_.size()) return x;
        return section_.signs().cwiseProduct(x);
    }

    [[nodiscard]] Eigen::VectorXd offset_of(std::size_t from, std::size_t to) const {
        return section_.difference(place(to), place(from));
    }

    // Where the planes of two nodes meet half way: by how much the first lies above the second.
    [[nodiscard]] double step(const std::vector<Plane>& planes, Eigen::Index angle, std::size_t from, std::size_t to,
                              const Eigen::VectorXd& offset) const {
        const std::size_t count = points_.size();
        const auto at = [&](std::size_t node, const Eigen::VectorXd& d) {
            const Plane& plane = planes[node % count];
            if (node < count) return plane.value + plane.slope.dot(d);
            return section_.signs()[angle] * (plane.value + plane.slope.dot(section_.signs().cwiseProduct(d)));
        };
        return at(from, 0.5 * offset) - at(to, -0.5 * offset);
    }

    [[nodiscard]] Eigen::MatrixXd offsets(std::size_t k, Eigen::Index crowd) const {
        Eigen::MatrixXd result(crowd, section_.dimension());
        for (Eigen::Index m = 0; m < crowd; ++m) {
            const Neighbour& near = neighbours_[k][static_cast<std::size_t>(m)];
            for (Eigen::Index d = 0; d < section_.dimension(); ++d) {
                const double sign = near.mirrored ? section_.signs()[d] : 1.0;
                result(m, d) =
                    section_.difference(sign * section_.point(near.index)[d], section_.point(points_[k])[d], d);
            }
        }
        return result;
    }

    [[nodiscard]] Plane fitted(std::size_t k, const Eigen::VectorXd& values) const {
        return fitted(offsets(k, values.size()), values);
    }

    [[nodiscard]] static Plane fitted(const Eigen::MatrixXd& offsets, const Eigen::VectorXd& values) {
        const Eigen::Index n = offsets.cols(), crowd = offsets.rows();
        Eigen::MatrixXd design(crowd, n + 1);
        design.col(0).setOnes();
        design.rightCols(n) = offsets;
        Eigen::MatrixXd normal = design.transpose() * design;
        const double spread = offsets.squaredNorm() / static_cast<double>(n);
        normal.diagonal().tail(n).array() += slope_ridge * spread + std::numeric_limits<double>::min();
        const Eigen::VectorXd solution = models::LdltFactor(normal).solve(Eigen::VectorXd(design.transpose() * values));
        Plane plane{solution[0], solution.tail(n), 0.0};
        const double freedom = static_cast<double>(std::max<Eigen::Index>(1, crowd - n - 1));
        plane.residual = std::sqrt((values - design * solution).squaredNorm() / freedom);
        return plane;
    }

    [[nodiscard]] Plane wrapped_plane(std::size_t k, Eigen::Index angle, std::size_t wanted) const {
        const auto crowd = static_cast<Eigen::Index>(std::min(wanted, crowd_));
        const Eigen::MatrixXd d = offsets(k, crowd);
        Eigen::VectorXd raw(crowd), values(crowd);
        for (Eigen::Index m = 0; m < crowd; ++m) {
            const Neighbour& near = neighbours_[k][static_cast<std::size_t>(m)];
            raw[m] = (near.mirrored ? section_.signs()[angle] : 1.0) * read(number_[near.index], angle);
        }
        // about the mean direction, so that the nearest point's own error does not decide
        double c = 0.0, s = 0.0;
        for (Eigen::Index m = 0; m < crowd; ++m) {
            c += std::cos(two_pi * raw[m]);
            s += std::sin(two_pi * raw[m]);
        }
        const double mean = std::atan2(s, c) / (two_pi);
        for (Eigen::Index m = 0; m < crowd; ++m)
            values[m] = mean + fraction(raw[m] - mean);
        Plane plane = fitted(d, values);
        for (int round = 0; round < fit_rounds; ++round) {
            bool changed = false;
            for (Eigen::Index m = 0; m < crowd; ++m) {
                const double expected = plane.value + plane.slope.dot(d.row(m));
                const double now = expected + fraction(raw[m] - expected);
                if (std::abs(now - values[m]) > 0.5) changed = true;
                values[m] = now;
            }
            if (!changed) break;
            plane = fitted(d, values);
        }
        return plane;
    }

    const SectionPoints& section_;
    std::vector<std::size_t> points_;  // that have an image
    std::vector<std::uint32_t> number_;
    std::size_t crowd_ = 0;
    std::vector<std::vector<Neighbour>> neighbours_;
};

// Whole turns by which the mirrored half lies above the mirror image of the other: the most frequent.
double mirror_turns(const std::vector<double>& lifted, double sign) {
    const std::size_t count = lifted.size() / 2;
    std::map<double, std::size_t> frequency;
    for (std::size_t k = 0; k < count; ++k)
        ++frequency[std::nearbyint(lifted[count + k] - sign * lifted[k])];
    return std::max_element(frequency.begin(), frequency.end(),
                            [](const auto& a, const auto& b) { return a.second < b.second; })
        ->first;
}

}  // namespace

Eigen::MatrixXd displacements_as_read(const SectionPoints& section) {
    const Eigen::Index n = section.dimension();
    Eigen::MatrixXd result = Eigen::MatrixXd::Constant(n, static_cast<Eigen::Index>(section.size()), std::nan(""));
    for (std::size_t i = 0; i < section.size(); ++i) {
        if (!section.has_image(i)) continue;
        for (Eigen::Index d = 0; d < n; ++d)
            result(d, static_cast<Eigen::Index>(i)) =
                section.is_angle(d) && section.turns_known()
                    ? section.advance(i, d)
                    : section.difference(section.point(i + 1)[d], section.point(i)[d], d);
    }
    return result;
}

SectionLift lift_section(const SectionPoints& section, const NeighbourIndex& grid) {
    const Eigen::Index n = section.dimension();
    SectionLift lift{displacements_as_read(section), Eigen::VectorXd::Zero(n)};
    std::vector<Eigen::Index> unknown;  // angles of which the turns must be found
    for (Eigen::Index d = 0; d < n; ++d)
        if (section.is_angle(d) && !section.turns_known()) unknown.push_back(d);
    if (unknown.empty() || section.image_count() == 0) return lift;

    const Lifter lifter(section, grid);
    const auto coefficients = static_cast<double>(n + 1);
    double squares = 0.0;
    for (const Eigen::Index d : unknown) {
        std::vector<double> best;
        double least = std::numeric_limits<double>::infinity();
        for (const double crowd : crowds) {
            std::vector<double> lifted = lifter.lifted(d, static_cast<std::size_t>(crowd * coefficients));
            const double rough = lifter.roughness(lifted);
            if (!(rough < least)) continue;
            least = rough;
            best = std::move(lifted);
        }
        squares += least * least;
        if (section.symmetric()) lift.offset[d] = 0.5 * mirror_turns(best, section.signs()[d]);
        for (std::size_t k = 0; k < lifter.points().size(); ++k)
            lift.displacement(d, static_cast<Eigen::Index>(lifter.points()[k])) = best[k];
    }
    lift.residual = std::sqrt(squares);
    return lift;
}

}  // namespace orbid::orbits
