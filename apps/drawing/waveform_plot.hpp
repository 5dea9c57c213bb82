#pragma once

#include <string>
#include <vector>

#include "apps/drawing/chart.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// Readings of one record over one turn of its orbit, in the order of their places.
struct PlottedWaveform {
    std::string label;
    std::vector<double> measured_at;  ///< share of the orbit in [0, 1)
    std::vector<double> measured;     ///< nan = missing
    std::vector<double> computed_at;
    std::vector<double> computed;
};

/// The records of one coordinate, in one frame.
struct WaveformPanel {
    orbits::SeriesCoordinate coordinate;
    std::vector<PlottedWaveform> waveforms;
};

/// Measured (markers) and computed (lines) waveforms, a frame for each coordinate.
[[nodiscard]] Chart waveform_chart(const std::vector<WaveformPanel>& panels);

}  // namespace orbid::apps
