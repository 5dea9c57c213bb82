#include "apps/drawing/waveform_plot.hpp"

#include <algorithm>

#include "apps/drawing/figure.hpp"

namespace orbid::apps {

namespace {

void draw_waveform(Panel& panel, const PlottedWaveform& waveform, std::size_t index) {
    const double font = panel.figure().font();
    panel.curve(waveform.computed_at, waveform.computed, {series_marker(index, 1.0).colour, 0.9});
    // Some 60 markers on a column.
    const auto most = static_cast<std::size_t>(0.24 * panel.figure().width());
    const std::size_t every = (waveform.measured.size() + most - 1) / most;
    std::vector<double> x;
    std::vector<double> y;
    for (std::size_t k = 0; k < waveform.measured.size(); k += every) {
        x.push_back(waveform.measured_at[k]);
        y.push_back(waveform.measured[k]);
    }
    panel.markers(x, y, series_marker(index, 0.16 * font), Panel::Filling::open);
}

}  // namespace

std::string waveform_svg(const std::vector<WaveformPanel>& panels, const std::string& heading, const PlotStyle& style) {
    const std::string description = "measured (markers) and computed (lines) over one turn of the orbit";
    Figure figure(style);
    figure.title(heading, description);
    std::vector<LegendEntry> legend;
    for (const PlottedWaveform& waveform : panels.front().waveforms)
        legend.push_back(
            {waveform.label, LegendEntry::Kind::marker, series_marker(legend.size(), 0.2 * figure.font()), {}});
    figure.legend(legend);
    for (const auto& [coordinate, waveforms] : panels) {
        PlotRange range;
        for (const PlottedWaveform& waveform : waveforms) {
            range.include(waveform.measured);
            range.include(waveform.computed);
        }
        Panel panel(figure, figure.row(0.6 * style.height * figure.width()),
                    linear_axis("share of the orbit", "", 0.0, 1.0), plot_axis(coordinate, range, 5));
        panel.open();
        for (std::size_t w = 0; w < waveforms.size(); ++w)
            draw_waveform(panel, waveforms[w], w);
        panel.frame();
    }
    return figure.svg("Steady states", description);
}

}  // namespace orbid::apps
