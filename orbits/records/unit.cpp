#include "orbits/records/unit.hpp"

#include <array>
#include <numbers>

namespace orbid::orbits {
namespace {

constexpr double pi = std::numbers::pi;

enum class Quantity { angle, angle_rate, time, length, velocity, acceleration };

struct Unit {
    std::string_view name;
    Quantity quantity;
    double size;  ///< in the SI unit of the quantity
};

constexpr std::array units{Unit{"rad", Quantity::angle, 1.0},
                           Unit{"mrad", Quantity::angle, 1e-3},
                           Unit{"deg", Quantity::angle, pi / 180.0},
                           Unit{"arcmin", Quantity::angle, pi / 10800.0},
                           Unit{"turns", Quantity::angle, 2.0 * pi},
                           Unit{"turn", Quantity::angle, 2.0 * pi},
                           Unit{"rad/s", Quantity::angle_rate, 1.0},
                           Unit{"mrad/s", Quantity::angle_rate, 1e-3},
                           Unit{"deg/s", Quantity::angle_rate, pi / 180.0},
                           Unit{"turns/s", Quantity::angle_rate, 2.0 * pi},
                           Unit{"rpm", Quantity::angle_rate, pi / 30.0},
                           Unit{"s", Quantity::time, 1.0},
                           Unit{"ms", Quantity::time, 1e-3},
                           Unit{"us", Quantity::time, 1e-6},
                           Unit{"min", Quantity::time, 60.0},
                           Unit{"h", Quantity::time, 3600.0},
                           Unit{"m", Quantity::length, 1.0},
                           Unit{"cm", Quantity::length, 1e-2},
                           Unit{"mm", Quantity::length, 1e-3},
                           Unit{"km", Quantity::length, 1e3},
                           Unit{"m/s", Quantity::velocity, 1.0},
                           Unit{"cm/s", Quantity::velocity, 1e-2},
                           Unit{"mm/s", Quantity::velocity, 1e-3},
                           Unit{"km/h", Quantity::velocity, 1.0 / 3.6},
                           Unit{"m/s^2", Quantity::acceleration, 1.0},
                           Unit{"cm/s^2", Quantity::acceleration, 1e-2},
                           Unit{"mm/s^2", Quantity::acceleration, 1e-3},
                           Unit{"g", Quantity::acceleration, 9.80665}};  // standard gravity, as accelerometers show

const Unit* find(std::string_view name) {
    for (const Unit& unit : units)
        if (unit.name == name) return &unit;
    return nullptr;
}

}  // namespace

std::optional<double> unit_factor(std::string_view from, std::string_view to) {
    if (from.empty() || from == to) return 1.0;
    const Unit* given = find(from);
    const Unit* wanted = find(to);
    if (given == nullptr || wanted == nullptr || given->quantity != wanted->quantity) return std::nullopt;
    return given->size / wanted->size;
}

std::string units_like(std::string_view to) {
    const Unit* wanted = find(to);
    if (wanted == nullptr) return std::string(to);
    std::string list;
    for (const Unit& unit : units) {
        if (unit.quantity != wanted->quantity) continue;
        if (!list.empty()) list += ", ";
        list += unit.name;
    }
    return list;
}

}  // namespace orbid::orbits
