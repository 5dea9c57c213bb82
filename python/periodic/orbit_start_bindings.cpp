#include "python/periodic/orbit_start_bindings.hpp"

#include <cmath>
#include <string>

#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/properties.hpp"

namespace orbid::python {

namespace py = pybind11;

periodic::StartingSolution orbit_start(const models::System& system, const Eigen::VectorXd& theta,
                                       const py::object& guess, const py::object& period, const py::object& section,
                                       double phase, const std::vector<int>& rotation,
                                       const models::FlowOptions& flow) {
    periodic::StartingSolution start;
    start.points = matrix(records(guess, "guess", system.dimension()));
    start.rotation = rotation;
    start.phase = phase;
    start.section = plane(system, section);
    const bool autonomous = system.kind() == models::Kind::autonomous;
    if (start.section && !autonomous) throw py::value_error("section: of autonomous models");
    if (autonomous && !start.section) {
        if (period.is_none()) throw py::value_error("period: None; without a section the duration [s] is needed");
        start.time = *finite_vector(period, "period", 1).data();
        return start;
    }
    if (period.is_none()) return start;
    const double given = *finite_vector(period, "period", 1).data();
    const Eigen::Index count = start.points.cols();
    // Beyond that one state says nothing of where the orbit is.
    constexpr double longest = 1e6;
    if (!(given >= 1.0 && given <= longest) || std::floor(given) != given)
        throw py::value_error("period: must be a whole number >= 1 of periods of the forcing, iterations or crossings");
    const auto periods = static_cast<Eigen::Index>(given);
    if (count == periods) return start;
    if (count != 1)
        throw py::value_error("guess: " + std::to_string(count) +
                              " points, needs one or period = " + std::to_string(periods));
    if (autonomous) throw py::value_error("guess: one point for each crossing is needed");
    const auto result = unlocked(
        [&] { return system.ensemble(start.points, phase, static_cast<std::size_t>(periods - 1), theta, flow); });
    if (result.status.front() != models::FlowStatus::ok)
        throw py::value_error("guess: cannot be followed over the period: " +
                              std::string(models::description(result.status.front())));
    start.points = result.sections.front();
    return start;
}

}  // namespace orbid::python
