#include "apps/drawing/waveform_plot.hpp"

#include "models/definition/parameter.hpp"

namespace orbid::apps {

Chart waveform_chart(const std::vector<WaveformPanel>& panels) {
    Chart chart{"waveform", "Steady states", "Coordinate", {}, Chart::Arrangement::stacked};
    chart.description = "measured (markers) and computed (lines) over one turn of the orbit";
    for (const auto& [coordinate, waveforms] : panels) {
        ChartView view;
        ChartRange range;
        int style = 0;
        for (const PlottedWaveform& waveform : waveforms) {
            style = style % 8 + 1;
            ChartLayer computed{LayerKind::line, waveform.label, style};
            for (std::size_t k = 0; k < waveform.computed.size(); ++k)
                computed.follow(waveform.computed_at[k], waveform.computed[k], coordinate.angle);
            ChartLayer measured{LayerKind::points, waveform.label, style};
            measured.open = true;
            for (std::size_t k = 0; k < waveform.measured.size(); ++k)
                measured.add(waveform.measured_at[k],
                             coordinate.angle ? models::wrapped(waveform.measured[k]) : waveform.measured[k]);
            range.include(computed.y);
            range.include(measured.y);
            view.add(std::move(computed));
            view.add(std::move(measured));
        }
        view.label = display_name(coordinate.name);
        view.x = {"share of the orbit", "", 0.0, 1.0};
        view.y = range.axis(coordinate);
        chart.add(std::move(view));
    }
    return chart;
}

}  // namespace orbid::apps
