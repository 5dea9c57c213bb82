#include "apps/drawing/waveform_plot.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/drawing/markup_text.hpp"
#include "apps/drawing/plot_frame.hpp"
#include "apps/drawing/plot_marker.hpp"

namespace orbid::apps {

namespace {

using Out = std::back_insert_iterator<fmt::memory_buffer>;

/// Colours of plot_marker that differ.
constexpr int colours = 8;

std::string_view colour(std::size_t waveform) {
    return plot_marker(1 + static_cast<int>(waveform % colours)).colour;
}

void require(const std::vector<PlottedWaveform>& waveforms) {
    if (waveforms.empty()) throw std::invalid_argument("waveform plot: needs at least one waveform");
    for (const PlottedWaveform& one : waveforms) {
        if (one.measured_at.size() != one.measured.size() || one.computed.size() < 2)
            throw std::invalid_argument(fmt::format("waveform plot: {}: {} places for {} readings, {} computed",
                                                    one.label, one.measured_at.size(), one.measured.size(),
                                                    one.computed.size()));
    }
}

PlotFrame waveform_frame(const orbits::SeriesCoordinate& coordinate, const std::vector<PlottedWaveform>& waveforms) {
    double lowest = std::numeric_limits<double>::infinity();
    double highest = -lowest;
    const auto include = [&](double value) {
        if (!std::isfinite(value)) return;
        lowest = std::min(lowest, value);
        highest = std::max(highest, value);
    };
    for (const PlottedWaveform& one : waveforms) {
        for (const double value : one.measured)
            include(value);
        for (const double value : one.computed)
            include(value);
    }
    PlotFrame frame{plot_axis({"share of the orbit", "1", false}, 0.0, 1.0), plot_axis(coordinate, lowest, highest)};
    frame.x_axis.lower = 0.0;
    frame.x_axis.upper = 1.0;
    return frame;
}

void draw_measured(const std::vector<PlottedWaveform>& waveforms, const PlotFrame& frame, Out out) {
    for (std::size_t w = 0; w < waveforms.size(); ++w) {
        fmt::format_to(out,
                       "<path fill=\"none\" stroke=\"{}\" stroke-opacity=\"0.55\" stroke-width=\"4\" "
                       "stroke-linecap=\"round\" d=\"",
                       colour(w));
        for (Eigen::Index k = 0; k < waveforms[w].measured.size(); ++k) {
            const double value = waveforms[w].measured[k];
            if (std::isfinite(value))
                fmt::format_to(out, "M{:.1f} {:.1f}h0", frame.x(waveforms[w].measured_at[k]), frame.y(value));
        }
        fmt::format_to(out, "\"/>\n");
    }
}

void draw_lines(const std::vector<PlottedWaveform>& waveforms, const PlotFrame& frame, Out out) {
    for (std::size_t w = 0; w < waveforms.size(); ++w) {
        const Eigen::VectorXd& values = waveforms[w].computed;
        fmt::format_to(out, "<path fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\" d=\"", colour(w));
        double last = std::numeric_limits<double>::quiet_NaN();
        for (Eigen::Index k = 0; k < values.size(); ++k) {
            if (!std::isfinite(values[k])) continue;
            const double y = frame.y(values[k]);
            // A jump over half of the frame is an angle that came round.
            const bool joined = std::abs(y - last) < 0.5 * (PlotFrame::bottom - PlotFrame::top);
            const double share = static_cast<double>(k) / static_cast<double>(values.size() - 1);
            fmt::format_to(out, "{}{:.1f} {:.1f}", joined ? 'L' : 'M', frame.x(share), y);
            last = y;
        }
        fmt::format_to(out, "\"/>\n");
    }
}

void draw_waveform_legend(const std::vector<PlottedWaveform>& waveforms, Out out) {
    fmt::format_to(out, "<g font-size=\"14\" fill=\"#1d2430\">\n");
    const double step = std::min(170.0, (PlotFrame::right - PlotFrame::left) / static_cast<double>(waveforms.size()));
    for (std::size_t w = 0; w < waveforms.size(); ++w) {
        const double x = PlotFrame::left + 8.0 + step * static_cast<double>(w);
        fmt::format_to(out, "<path stroke=\"{}\" stroke-width=\"3\" d=\"M{:.1f} 86h14\"/>\n", colour(w), x - 6.0);
        fmt::format_to(out, "<text x=\"{:.1f}\" y=\"91\">{}</text>\n", x + 13.0, markup_text(waveforms[w].label));
    }
    fmt::format_to(out, "</g>\n");
}

}  // namespace

std::string waveform_svg(const orbits::SeriesCoordinate& coordinate, const std::vector<PlottedWaveform>& waveforms,
                         const std::string& title) {
    require(waveforms);
    const PlotFrame frame = waveform_frame(coordinate, waveforms);
    fmt::memory_buffer buffer;
    const Out out(buffer);
    fmt::format_to(out, "{}{}",
                   frame.head(title.empty() ? "Steady states" : title,
                              "measured (dots) and computed (lines) over one turn of the orbit"),
                   frame.grid());
    draw_measured(waveforms, frame, out);
    fmt::format_to(out, "{}", frame.border());
    draw_lines(waveforms, frame, out);
    draw_waveform_legend(waveforms, out);
    fmt::format_to(out, "</svg>\n");
    return fmt::to_string(buffer);
}

}  // namespace orbid::apps
