#include "orbits/spline_map/spline_basis.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace orbid::orbits {
namespace {

constexpr std::size_t reach = 4;  // functions of one axis that overlap in a cell
constexpr std::size_t maximum_dimension = 4;

// Values and two derivatives (per spacing) of the four cubic B-splines that overlap in a cell, u in [0, 1].
struct AxisSupport {
    std::array<double, reach> value, slope, bending;
};

AxisSupport cubic_splines(double u) {
    const double v = 1.0 - u;
    return {{v * v * v / 6.0, (4.0 + 3.0 * u * u * (u - 2.0)) / 6.0, (4.0 + 3.0 * v * v * (v - 2.0)) / 6.0,
             u * u * u / 6.0},
            {-0.5 * v * v, 0.5 * u * (3.0 * u - 4.0), -0.5 * v * (3.0 * v - 4.0), 0.5 * u * u},
            {v, 3.0 * u - 2.0, 3.0 * v - 2.0, u}};
}

}  // namespace

SplineBasis::SplineBasis(const SectionPoints& section, const Eigen::MatrixXd& places, double spacing)
    : section_(&section) {
    const auto n = static_cast<std::size_t>(section.dimension());
    if (!(spacing > 0.0))
        throw std::invalid_argument("PatchBasis: spacing must be > 0, got " + std::to_string(spacing));
    if (n > maximum_dimension)
        throw std::invalid_argument("PatchBasis: at most 4 coordinates, got " + std::to_string(n));
    axes_.resize(n);
    spacing_.assign(n, spacing);
    for (std::size_t d = 0; d < n; ++d)
        lay_axis(d, places);
    number_patches(occupied(places));
}

void SplineBasis::lay_axis(std::size_t d, const Eigen::MatrixXd& places) {
    const double spacing = spacing_[d];
    Axis& axis = axes_[d];
    axis.circle = section_->angle()[d] != 0;
    if (axis.circle) {
        axis.cells = std::max<std::int64_t>(static_cast<std::int64_t>(reach), std::llround(1.0 / spacing));
        spacing_[d] = 1.0 / static_cast<double>(axis.cells);
        axis.origin = -0.5;
        axis.functions = axis.cells;
        return;
    }
    double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
    for (Eigen::Index i = 0; i < places.cols(); ++i) {
        const double x = places(static_cast<Eigen::Index>(d), i);
        if (!std::isfinite(x)) continue;
        lowest = std::min(lowest, x);
        highest = std::max(highest, x);
    }
    if (!(lowest <= highest)) lowest = highest = 0.0;
    if (section_->symmetric() && section_->signs()[static_cast<Eigen::Index>(d)] < 0.0) {
        highest = std::max(std::abs(lowest), std::abs(highest));
        lowest = -highest;
    }
    axis.cells = std::max<std::int64_t>(1, static_cast<std::int64_t>(std::ceil((highest - lowest) / spacing)));
    axis.origin = 0.5 * (lowest + highest) - 0.5 * static_cast<double>(axis.cells) * spacing;
    axis.functions = axis.cells + static_cast<std::int64_t>(reach) - 1;
}

std::vector<char> SplineBasis::occupied(const Eigen::MatrixXd& places) const {
    const std::size_t n = axes_.size();
    std::size_t total = 1, overlapping = 1;
    for (const Axis& axis : axes_) {
        total *= static_cast<std::size_t>(axis.functions);
        overlapping *= reach;
    }
    std::vector<char> result(total, 0);
    std::array<std::int64_t, maximum_dimension> cell{};
    std::array<double, maximum_dimension> u{};
    for (Eigen::Index i = 0; i < places.cols(); ++i) {
        if (!places.col(i).allFinite() || !locate(places.col(i).data(), cell, u)) continue;
        for (std::size_t f = 0; f < overlapping; ++f) {
            std::int64_t raw = 0;
            std::size_t rest = f;
            for (std::size_t d = 0; d < n; ++d, rest /= reach)
                raw = raw * axes_[d].functions + function_of(d, cell[d] + static_cast<std::int64_t>(rest % reach));
            result[static_cast<std::size_t>(raw)] = 1;
        }
    }
    if (section_->symmetric())
        for (std::size_t raw = 0; raw < total; ++raw)
            if (result[raw]) result[static_cast<std::size_t>(mirrored_function(static_cast<std::int64_t>(raw)))] = 1;
    return result;
}

void SplineBasis::number_patches(const std::vector<char>& with_data) {
    number_.assign(with_data.size(), -1);
    flipped_.assign(with_data.size(), 0);
    for (std::size_t at = 0; at < with_data.size(); ++at) {
        if (!with_data[at]) continue;
        const auto raw = static_cast<std::int64_t>(at);
        const std::int64_t image = section_->symmetric() ? mirrored_function(raw) : raw;
        if (image < raw) {
            number_[at] = number_[static_cast<std::size_t>(image)];
            flipped_[at] = 1;
            continue;
        }
        number_[at] = static_cast<std::int32_t>(patches_++);
        for (Eigen::Index d = 0; d < dimension(); ++d)
            fixed_.push_back(section_->symmetric() && image == raw && section_->signs()[d] < 0.0 ? 1 : 0);
    }
}

bool SplineBasis::locate(const double* place, std::array<std::int64_t, 4>& cell, std::array<double, 4>& u) const {
    for (std::size_t d = 0; d < axes_.size(); ++d) {
        const Axis& axis = axes_[d];
        double x = (place[d] - axis.origin) / spacing_[d];
        const auto cells = static_cast<double>(axis.cells);
        if (axis.circle)
            x -= cells * std::floor(x / cells);
        else if (!(x >= 0.0 && x <= cells))
            return false;
        const double below = std::min(std::floor(x), cells - 1.0);
        cell[d] = static_cast<std::int64_t>(below);
        u[d] = x - below;
    }
    return true;
}

std::int64_t SplineBasis::region(const double* place, std::int64_t width) const {
    std::array<std::int64_t, maximum_dimension> cell{};
    std::array<double, maximum_dimension> u{};
    if (!locate(place, cell, u)) return -1;
    std::int64_t box = 0;
    for (std::size_t d = 0; d < axes_.size(); ++d)
        box = box * (axes_[d].cells / width + 1) + cell[d] / width;
    return box;
}

// Function `offset` places along the axis: cell + 0 ... cell + 3 overlap in a cell. On the circle function j is centred
// on grid point j - 1.
std::int64_t SplineBasis::function_of(std::size_t d, std::int64_t offset) const {
    return axes_[d].circle ? offset % axes_[d].functions : offset;
}

std::int64_t SplineBasis::mirrored_function(std::int64_t raw) const {
    std::int64_t result = 0, factor = 1;
    for (std::size_t d = axes_.size(); d-- > 0;) {
        const std::int64_t functions = axes_[d].functions;
        std::int64_t own = raw % functions;
        raw /= functions;
        if (section_->signs()[static_cast<Eigen::Index>(d)] < 0.0)
            // Centres lie at origin + (j - 1) spacing; the origin of a circle is minus half a turn, which is its own
            // mirror image.
            own = axes_[d].circle ? (2 - own + functions) % functions : functions - 1 - own;
        result += own * factor;
        factor *= functions;
    }
    return result;
}

void SplineBasis::support(const double* place, int derivatives, SplineSupport& result) const {
    const std::size_t n = axes_.size();
    std::array<std::int64_t, maximum_dimension> cell{};
    std::array<double, maximum_dimension> u{};
    result.inside = locate(place, cell, u);
    if (!result.inside) return;
    std::array<AxisSupport, maximum_dimension> axis;
    std::size_t count = 1;
    for (std::size_t d = 0; d < n; ++d) {
        axis[d] = cubic_splines(u[d]);
        count *= reach;
    }
    const auto columns = static_cast<Eigen::Index>(count), rows = static_cast<Eigen::Index>(n);
    result.patch.resize(count);
    result.mirrored.resize(count);
    result.value.resize(columns);
    if (derivatives > 0) result.slope.resize(rows, columns);
    if (derivatives > 1) result.bending.resize(count);
    for (std::size_t f = 0; f < count; ++f) {
        const auto column = static_cast<Eigen::Index>(f);
        std::array<std::size_t, maximum_dimension> k{};
        std::int64_t raw = 0;
        std::size_t rest = f;
        double value = 1.0;
        for (std::size_t d = 0; d < n; ++d, rest /= reach) {
            k[d] = rest % reach;
            raw = raw * axes_[d].functions + function_of(d, cell[d] + static_cast<std::int64_t>(k[d]));
            value *= axis[d].value[k[d]];
        }
        const std::int32_t number = number_[static_cast<std::size_t>(raw)];
        if (number < 0) {
            result.inside = false;
            return;
        }
        result.patch[f] = number;
        result.mirrored[f] = flipped_[static_cast<std::size_t>(raw)];
        result.value[column] = value;
        if (derivatives < 1) continue;
        for (std::size_t a = 0; a < n; ++a) {
            double slope = 1.0 / spacing_[a];
            for (std::size_t d = 0; d < n; ++d)
                slope *= d == a ? axis[d].slope[k[d]] : axis[d].value[k[d]];
            result.slope(static_cast<Eigen::Index>(a), column) = slope;
        }
        if (derivatives < 2) continue;
        Eigen::MatrixXd& bending = result.bending[f];
        bending.resize(rows, rows);
        for (std::size_t a = 0; a < n; ++a)
            for (std::size_t b = 0; b < n; ++b) {
                double product = 1.0 / (spacing_[a] * spacing_[b]);
                for (std::size_t d = 0; d < n; ++d)
                    product *= d == a && d == b   ? axis[d].bending[k[d]]
                               : d == a || d == b ? axis[d].slope[k[d]]
                                                  : axis[d].value[k[d]];
                bending(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)) = product;
            }
    }
}

}  // namespace orbid::orbits
