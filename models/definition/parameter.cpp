#include "models/definition/parameter.hpp"

#include <cmath>
#include <numbers>

namespace orbid::models {

bool contains(Domain domain, double value) {
    if (!std::isfinite(value)) return false;
    switch (domain) {
        case Domain::real:
            return true;
        case Domain::positive:
            return value > 0.0;
        case Domain::nonnegative:
            return value >= 0.0;
    }
    return false;
}

std::string_view rule(Domain domain) {
    switch (domain) {
        case Domain::real:
            return "a finite number";
        case Domain::positive:
            return "> 0";
        case Domain::nonnegative:
            return ">= 0";
    }
    return "";
}

double wrapped(double angle_rad) {
    // remainder() is exact and lies in [-pi, pi]; only its lower end belongs to the other side.
    const double angle = std::remainder(angle_rad, 2.0 * std::numbers::pi);
    return angle <= -std::numbers::pi ? angle + 2.0 * std::numbers::pi : angle;
}

}  // namespace orbid::models
