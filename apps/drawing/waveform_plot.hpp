#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "orbits/records/series.hpp"

namespace orbid::apps {

/// Readings of one record over one turn of its orbit.
struct PlottedWaveform {
    std::string label;
    Eigen::VectorXd measured_at;  ///< shape (m): share of the orbit in [0, 1)
    Eigen::VectorXd measured;     ///< shape (m); nan = missing
    Eigen::VectorXd computed;     ///< readings at equal shares from 0 to 1, both included
};

/// SVG of measured (dots) and computed (lines) waveforms of one coordinate, all records in one frame.
/// @throws std::invalid_argument without waveforms, or where lengths differ.
[[nodiscard]] std::string waveform_svg(const orbits::SeriesCoordinate& coordinate,
                                       const std::vector<PlottedWaveform>& waveforms, const std::string& title);

}  // namespace orbid::apps
