#include "apps/drawing/plot_marker.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

namespace orbid::apps {
namespace {

enum class Shape { circle, square, triangle, diamond, triangle_down };

struct Style {
    std::string_view colour;
    Shape shape;
    double radius;  ///< px
};

constexpr std::array<Style, 8> styles{{{"#d55e00", Shape::circle, 6.4},
                                       {"#0072b2", Shape::square, 5.6},
                                       {"#009e73", Shape::triangle, 5.0},
                                       {"#e69f00", Shape::diamond, 4.2},
                                       {"#cc79a7", Shape::triangle_down, 3.8},
                                       {"#56b4e9", Shape::circle, 3.0},
                                       {"#000000", Shape::square, 2.6},
                                       {"#8c510a", Shape::diamond, 2.6}}};

/// Factors on the radius give the shapes about the area of the circle.
std::string outline(Shape shape, double r) {
    const auto f = [](double value) { return fmt::format("{:.2f}", value); };
    const auto joined = [&](double dx, double dy) { return f(dx) + " " + f(dy); };
    switch (shape) {
        case Shape::square:
            return "m" + joined(-0.88 * r, -0.88 * r) + "h" + f(1.76 * r) + "v" + f(1.76 * r) + "h" + f(-1.76 * r) +
                   "z";
        case Shape::triangle:
            return "m0 " + f(-1.2 * r) + "l" + joined(1.1 * r, 1.9 * r) + "h" + f(-2.2 * r) + "z";
        case Shape::triangle_down:
            return "m0 " + f(1.2 * r) + "l" + joined(1.1 * r, -1.9 * r) + "h" + f(-2.2 * r) + "z";
        case Shape::diamond:
            return "m0 " + f(-1.2 * r) + "l" + joined(1.2 * r, 1.2 * r) + " " + joined(-1.2 * r, 1.2 * r) + " " +
                   joined(-1.2 * r, -1.2 * r) + "z";
        case Shape::circle:
            break;
    }
    const std::string arc = "a" + joined(r, r) + " 0 1 0 ";
    return "m" + f(-r) + " 0" + arc + f(2.0 * r) + " 0 " + f(r) + " " + f(r) + " 0 1 0 " + f(-2.0 * r) + " 0z";
}

}  // namespace

PlotMarker plot_marker(int period, double scale) {
    const Style& style = styles[static_cast<std::size_t>(std::clamp(period, 1, static_cast<int>(styles.size()))) - 1];
    return {style.colour, outline(style.shape, scale * style.radius)};
}

}  // namespace orbid::apps
