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
    std::int64_t total = 1;
    for (std::size_t d = 0; d < n; ++d) {
        Axis& axis = axes_[d];
        axis.circle = section.angle()[d] != 0;
        if (axis.circle) {
            axis.cells = std::max<std::int64_t>(static_cast<std::int64_t>(reach), std::llround(1.0 / spacing));
            spacing_[d] = 1.0 / static_cast<double>(axis.cells);
            axis.origin = -0.5;
            axis.functions = axis.cells;
        } else {
            double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
            for (Eigen::Index i = 0; i < places.cols(); ++i) {
                const double x = places(static_cast<Eigen::Index>(d), i);
                if (!std::isfinite(x)) continue;
                lowest = std::min(lowest, x);
                highest = std::max(highest, x);
            }
            if (!(lowest <= highest)) lowest = highest = 0.0;
            if (section.symmetric() && section.signs()[static_cast<Eigen::Index>(d)] < 0.0) {
                highest = std::max(std::abs(lowest), std::abs(highest));
                lowest = -highest;
            }
            axis.cells = std::max<std::int64_t>(1, static_cast<std::int64_t>(std::ceil((highest - lowest) / spacing)));
            axis.origin = 0.5 * (lowest + highest) - 0.5 * static_cast<double>(axis.cells) * spacing;
            axis.functions = axis.cells + static_cast<std::int64_t>(reach) - 1;
        }
        total *= axis.functions;
    }

    std::vector<char> occupied(static_cast<std::size_t>(total), 0);
    std::array<std::int64_t, maximum_dimension> cell{};
    std::array<double, maximum_dimension> u{};
    const auto each_function = [&](const auto& use) {
        std::size_t count = 1;
        for (std::size_t d = 0; d < n; ++d)
            count *= reach;
        for (std::size_t f = 0; f < count; ++f) {
            std::int64_t raw = 0;
            std::size_t rest = f;
            for (std::size_t d = 0; d < n; ++d, rest /= reach)
                raw = raw * axes_[d].functions + function_of(d, cell[d] + static_cast<std::int64_t>(rest % reach));
            use(static_cast<std::size_t>(raw));
        }
    };
    for (Eigen::Index i = 0; i < places.cols(); ++i) {
        if (!places.col(i).allFinite() || !locate(places.col(i).data(), cell, u)) continue;
        each_function([&](std::size_t raw) { occupied[raw] = 1; });
    }
    if (section.symmetric())
        for (std::int64_t raw = 0; raw < total; ++raw)
            if (occupied[static_cast<std::size_t>(raw)]) occupied[static_cast<std::size_t>(mirrored_function(raw))] = 1;

    number_.assign(static_cast<std::size_t>(total), -1);
    flipped_.assign(static_cast<std::size_t>(total), 0);
    for (std::int64_t raw = 0; raw < total; ++raw) {
        const auto at = static_cast<std::size_t>(raw);
        if (!occupied[at]) continue;
        const std::int64_t image = section.symmetric() ? mirrored_function(raw) : raw;
        if (image < raw) {
            number_[at] = number_[static_cast<std::size_t>(image)];
            flipped_[at] = 1;
            continue;
        }
        number_[at] = static_cast<std::int32_t>(patches_++);
        for (std::size_t d = 0; d < n; ++d)
            fixed_.push_back(
                section.symmetric() && image == raw && section.signs()[static_cast<Eigen::Index>(d)] < 0.0 ? 1 : 0);
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

DifferenceRows SplineBasis::third_differences(Eigen::Index coordinate, std::int64_t width,
                                              std::vector<std::int64_t>& region) const {
    region.clear();
    const std::size_t n = axes_.size();
    const auto total = static_cast<std::int64_t>(number_.size());
    // (-1)^(m - j) binomial(m, j): coefficients of the m-th difference
    constexpr std::array<std::array<double, reach>, reach> difference{
        {{1, 0, 0, 0}, {-1, 1, 0, 0}, {1, -2, 1, 0}, {-1, 3, -3, 1}}};
    constexpr std::array<double, reach> factorial{1.0, 1.0, 2.0, 6.0};
    const double sign = section_->symmetric() ? section_->signs()[coordinate] : 1.0;

    DifferenceRows rows;
    std::vector<std::size_t> orders(n, 0);
    std::vector<std::pair<std::int32_t, double>> stencil;
    const auto add_all = [&] {
        double multiplicity = 6.0;  // 3! / (orders!): the norm of third derivatives does not depend on the axes' choice
        std::size_t members = 1;
        for (const std::size_t m : orders) {
            multiplicity /= factorial[m];
            members *= m + 1;
        }
        for (std::int64_t raw = 0; raw < total; ++raw) {
            if (number_[static_cast<std::size_t>(raw)] < 0) continue;
            stencil.clear();
            for (std::size_t member = 0; member < members; ++member) {
                std::int64_t other = 0, rest_of_raw = raw, factor = 1;
                std::size_t rest = member;
                double weight = 1.0;
                bool exists = true;
                for (std::size_t d = n; d-- > 0;) {
                    const std::size_t j = rest % (orders[d] + 1);
                    rest /= orders[d] + 1;
                    std::int64_t place = rest_of_raw % axes_[d].functions + static_cast<std::int64_t>(j);
                    rest_of_raw /= axes_[d].functions;
                    if (place >= axes_[d].functions) {
                        if (!axes_[d].circle) exists = false;
                        place -= axes_[d].functions;
                    }
                    other += place * factor;
                    factor *= axes_[d].functions;
                    weight *= difference[orders[d]][j];
                }
                if (!exists || number_[static_cast<std::size_t>(other)] < 0) break;
                const std::int64_t unknown = number_[static_cast<std::size_t>(other)] * static_cast<std::int64_t>(n) +
                                             static_cast<std::int64_t>(coordinate);
                if (flipped_[static_cast<std::size_t>(other)]) weight *= sign;
                stencil.emplace_back(static_cast<std::int32_t>(unknown), weight);
            }
            if (stencil.size() != members) continue;
            for (const auto& [unknown, weight] : stencil)
                if (!fixed_[static_cast<std::size_t>(unknown)])
                    rows.add(static_cast<std::size_t>(unknown), std::sqrt(multiplicity) * weight);
            rows.finish_row();
            std::int64_t box = 0, rest_of_raw = raw, factor = 1;
            for (std::size_t d = n; d-- > 0;) {
                const std::int64_t centre =
                    (rest_of_raw % axes_[d].functions + static_cast<std::int64_t>(orders[d] / 2)) % axes_[d].functions;
                rest_of_raw /= axes_[d].functions;
                box += centre / width * factor;
                factor *= axes_[d].functions / width + 1;
            }
            region.push_back(box);
        }
    };
    const auto distribute = [&](const auto& self, std::size_t d, std::size_t left) -> void {
        if (d + 1 == n) {
            orders[d] = left;
            add_all();
            return;
        }
        for (std::size_t m = 0; m <= left; ++m) {
            orders[d] = m;
            self(self, d + 1, left - m);
        }
    };
    distribute(distribute, 0, reach - 1);
    return rows;
}

}  // namespace orbid::orbits
