#include "apps/plot_marker.hpp"

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
    switch (shape) {
        case Shape::square:
            return fmt::format("m{0:.1f} {0:.1f}h{1:.1f}v{1:.1f}h{2:.1f}z", -0.88 * r, 1.76 * r, -1.76 * r);
        case Shape::triangle:
            return fmt::format("m0 {:.1f}l{:.1f} {:.1f}h{:.1f}z", -1.2 * r, 1.1 * r, 1.9 * r, -2.2 * r);
        case Shape::triangle_down:
            return fmt::format("m0 {:.1f}l{:.1f} {:.1f}h{:.1f}z", 1.2 * r, 1.1 * r, -1.9 * r, -2.2 * r);
        case Shape::diamond:
            return fmt::format("m0 {0:.1f}l{1:.1f} {1:.1f} {0:.1f} {1:.1f} {0:.1f} {0:.1f}z", -1.2 * r, 1.2 * r);
        case Shape::circle:
            break;
    }
    return fmt::format("m{0:.1f} 0a{1:.1f} {1:.1f} 0 1 0 {2:.1f} 0 {1:.1f} {1:.1f} 0 1 0 {3:.1f} 0z", -r, r, 2.0 * r,
                       -2.0 * r);
}

}  // namespace

PlotMarker plot_marker(int period) {
    const auto index = static_cast<std::size_t>(std::clamp(period, 1, static_cast<int>(styles.size()))) - 1;
    return {styles[index].colour, outline(styles[index].shape, styles[index].radius)};
}

}  // namespace orbid::apps
