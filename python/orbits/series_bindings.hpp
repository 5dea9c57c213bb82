#pragma once

#include <memory>
#include <string>
#include <vector>

#include <pybind11/pybind11.h>

#include "models/definition/sensor.hpp"
#include "models/system/system.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/series.hpp"

namespace orbid::python {

class NamedArguments;

/// The system as the library expects it.
[[nodiscard]] std::shared_ptr<const models::System> system_of(pybind11::handle system);

[[nodiscard]] std::vector<std::string> coordinate_names(const orbits::Series& series);

/// Coordinates of a series: a system's, or a list of names or of dicts with name, unit and angle.
[[nodiscard]] std::vector<orbits::SeriesCoordinate> series_coordinates(pybind11::handle coordinates);

/// A sensor, with the keys and rules of a job: type "state", "function" (readings) or "angle_difference" (angle, rate,
/// delay), with angle, step and rounding of an encoder; None: the state.
/// @throws TypeError, ValueError, KeyError naming the key.
[[nodiscard]] models::Sensor sensor(pybind11::handle description, const models::System& system);

/// "sampling" among keyword arguments: "samples" or "section"; not given, samples where records have times.
[[nodiscard]] orbits::Series::Sampling sampling(NamedArguments& given, bool timed);

/// Options of find_cycles() among keyword arguments; `names` of the coordinates.
[[nodiscard]] orbits::CycleSearchOptions search_options(NamedArguments& given, const std::vector<std::string>& names);

/// rtol, atol and maximum_steps among keyword arguments.
[[nodiscard]] models::FlowOptions flow_options(NamedArguments& given, models::FlowOptions usual);

/// Class Series and its files.
void bind_series(pybind11::module_& module);
/// read_csv, read_hdf5, write_csv, write_hdf5.
void bind_series_files(pybind11::module_& module);
/// simulate().
void bind_simulation(pybind11::module_& module);
/// Search of cycles, harvest.
void bind_cycles(pybind11::module_& module);
/// Lyapunov spectrum, correlation dimension, cycle expansion, delay embedding.
void bind_invariants(pybind11::module_& module);
/// Residuals of series and cycles.
void bind_series_residuals(pybind11::module_& module);

}  // namespace orbid::python
