#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "apps/drawing/figure.hpp"
#include "apps/drawing/waveform_plot.hpp"
#include "apps/report/plots/catalog_plots.hpp"
#include "apps/stored_run/stored_record.hpp"
#include "orbits/records/data_error.hpp"

/// Measured against predicted: records over time, steady states over their orbit.
namespace orbid::apps::catalog {

namespace {

using Json = StoredRun::Json;

}  // namespace

bool has_prediction(const StoredRun& run) {
    if (!has_residuals(run)) return false;
    // A job of cycles alone has no series to show.
    const auto pointer = Json::json_pointer("/estimate/residuals");
    if (!run.job.contains(pointer)) return false;
    const Json& list = run.job.at(pointer);
    return std::any_of(list.begin(), list.end(),
                       [](const Json& one) { return one.value("type", std::string()) != "cycles"; });
}

std::string prediction(const StoredRun& run, const PlotStyle& style) {
    const auto rows = rows_of(run);
    const ModelJob model = stored_model(run);
    // Pieces of one coordinate in one segment, in the order of the file.
    struct Piece {
        std::string experiment;
        std::string block;
        std::string coordinate;
        std::vector<double> at;
        std::vector<double> observed;
        std::vector<double> predicted;
    };
    std::vector<Piece> pieces;
    for (const ResidualRow& row : rows) {
        if (is_cycle(row)) continue;
        auto found = std::find_if(pieces.begin(), pieces.end(), [&](const Piece& piece) {
            return piece.experiment == row.experiment && piece.block == row.block && piece.coordinate == row.coordinate;
        });
        if (found == pieces.end())
            found = pieces.insert(pieces.end(), Piece{row.experiment, row.block, row.coordinate, {}, {}, {}});
        found->at.push_back(is_sampled(run, row.experiment) ? row.at : static_cast<double>(found->at.size()));
        found->observed.push_back(row.observed);
        found->predicted.push_back(row.predicted);
    }
    if (pieces.empty()) throw orbits::DataError((run.folder / "residuals.csv").string() + ": holds no series");
    constexpr std::size_t most = 8;  // panels of a page
    Figure figure(style);
    figure.title(run.title());
    const PlotMarker marker{"#7e8b9f", series_marker(0, 0.15 * figure.font()).outline};
    figure.legend({{"measured",
                    LegendEntry::Kind::marker,
                    PlotMarker{"#7e8b9f", series_marker(0, 0.2 * figure.font()).outline},
                    {}},
                   {"predicted", LegendEntry::Kind::line, {}, {"#d55e00", 1.0}}});
    const bool several = std::any_of(pieces.begin(), pieces.end(), [&](const Piece& piece) {
        return piece.block != pieces.front().block || piece.experiment != pieces.front().experiment;
    });
    const std::size_t count = std::min(pieces.size(), most);
    std::vector<std::array<PlotAxis, 2>> axes;
    double room = 0.0;
    for (std::size_t p = 0; p < count; ++p) {
        const Piece& piece = pieces[p];
        PlotRange x, y;
        x.include(piece.at);
        y.include(piece.observed);
        y.include(piece.predicted);
        orbits::SeriesCoordinate coordinate = coordinate_of(model, piece.coordinate);
        coordinate.angle = false;  // records of angles go on beyond a turn
        const bool timed = is_sampled(run, piece.experiment);
        const bool last = p + 1 == count;
        axes.push_back({linear_axis(!last   ? ""
                                    : timed ? "t"
                                            : "section",
                                    last && timed ? time_unit(model) : "", x.lowest, x.highest),
                        plot_axis(coordinate, y, 4)});
        room = std::max(room, room_for(figure, axes.back()[1]));
    }
    for (std::size_t p = 0; p < count; ++p) {
        const Piece& piece = pieces[p];
        const bool last = p + 1 == count;
        Panel panel(
            figure,
            figure.row(std::max(0.27 * figure.width(), 8.0 * figure.font()) + (last ? 1.4 * figure.font() : 0.0)),
            axes[p][0], axes[p][1], {true, true, true, room});
        panel.open();
        const std::size_t every = stride(piece.at.size(), 500);
        std::array<std::vector<double>, 2> shown;
        for (std::size_t k = 0; k < piece.at.size(); k += every) {
            shown[0].push_back(piece.at[k]);
            shown[1].push_back(piece.observed[k]);
        }
        panel.markers(shown[0], shown[1], marker);
        panel.curve(piece.at, piece.predicted, {"#d55e00", 0.9});
        panel.frame();
        if (several)
            panel.tag(piece.experiment == piece.block ? piece.block : piece.experiment + ", segment " + piece.block);
    }
    return figure.svg("Predicted against measured", fmt::format("{} of {} records, measured and predicted",
                                                                std::min(pieces.size(), most), pieces.size()));
}

bool has_waveform(const StoredRun& run) {
    return has_residuals(run) && run.result && run.result->contains("steady_states") &&
           !(*run.result)["steady_states"].empty();
}

std::string waveform(const StoredRun& run, const PlotStyle& style) {
    const auto rows = rows_of(run);
    const ModelJob model = stored_model(run);
    struct Point {
        double share;
        double observed;
        double predicted;
    };
    // By coordinate, the records in the order of the result.
    std::vector<WaveformPanel> panels;
    for (const Json& state : (*run.result)["steady_states"]) {
        const double time = number(state, "time");
        const auto experiment = state.value("experiment", std::string());
        const auto segment = state.value("segment", std::string());
        if (!(time > 0.0)) continue;
        std::map<std::string, std::vector<Point>> read;
        std::vector<std::string> order;
        for (const ResidualRow& row : rows) {
            if (row.experiment != experiment || row.block != segment) continue;
            if (!read.contains(row.coordinate)) order.push_back(row.coordinate);
            const double turns = row.at / time;
            read[row.coordinate].push_back({turns - std::floor(turns), row.observed, row.predicted});
        }
        for (const std::string& name : order) {
            auto panel = std::find_if(panels.begin(), panels.end(),
                                      [&](const WaveformPanel& one) { return one.coordinate.name == name; });
            if (panel == panels.end()) {
                panel = panels.insert(panels.end(), {coordinate_of(model, name), {}});
                panel->coordinate.angle = false;
            }
            std::sort(read[name].begin(), read[name].end(),
                      [](const Point& a, const Point& b) { return a.share < b.share; });
            PlottedWaveform& wave = panel->waveforms.emplace_back();
            wave.label = experiment == segment ? experiment : experiment + " " + segment;
            for (const Point& point : read[name]) {
                wave.measured_at.push_back(point.share);
                wave.measured.push_back(point.observed);
                wave.computed.push_back(point.predicted);
            }
            wave.computed_at = wave.measured_at;
        }
    }
    if (panels.empty()) throw orbits::DataError(run.folder.string() + ": no steady state was used");
    return waveform_svg(panels, run.title(), style);
}

}  // namespace orbid::apps::catalog
