#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "apps/drawing/figure.hpp"
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
        std::array<double, 2> x{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
        std::array<double, 2> y = x;
        for (std::size_t k = 0; k < piece.at.size(); ++k) {
            x = {std::min(x[0], piece.at[k]), std::max(x[1], piece.at[k])};
            for (const double value : {piece.observed[k], piece.predicted[k]}) {
                if (std::isfinite(value)) y = {std::min(y[0], value), std::max(y[1], value)};
            }
        }
        orbits::SeriesCoordinate coordinate = coordinate_of(model, piece.coordinate);
        coordinate.angle = false;  // records of angles go on beyond a turn
        const bool timed = is_sampled(run, piece.experiment);
        const bool last = p + 1 == count;
        axes.push_back({linear_axis(!last   ? ""
                                    : timed ? "t"
                                            : "section",
                                    last && timed ? time_unit(model) : "", x[0], x[1]),
                        plot_axis(coordinate, y[0], y[1], 4)});
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
    struct Wave {
        std::string name;
        std::vector<std::array<double, 3>> points;  ///< share of the orbit, measured, computed
    };
    // By coordinate, the records in the order of the result.
    std::vector<std::pair<std::string, std::vector<Wave>>> coordinates;
    for (const Json& state : (*run.result)["steady_states"]) {
        const double time = number(state, "time");
        const auto experiment = state.value("experiment", std::string());
        const auto segment = state.value("segment", std::string());
        if (!(time > 0.0)) continue;
        for (const ResidualRow& row : rows) {
            if (row.experiment != experiment || row.block != segment) continue;
            auto found = std::find_if(coordinates.begin(), coordinates.end(),
                                      [&](const auto& entry) { return entry.first == row.coordinate; });
            if (found == coordinates.end())
                found = coordinates.insert(coordinates.end(), {row.coordinate, std::vector<Wave>{}});
            const std::string name = experiment == segment ? experiment : experiment + " " + segment;
            if (found->second.empty() || found->second.back().name != name) found->second.push_back({name, {}});
            const double turns = row.at / time;
            found->second.back().points.push_back({turns - std::floor(turns), row.observed, row.predicted});
        }
    }
    if (coordinates.empty()) throw orbits::DataError(run.folder.string() + ": no steady state was used");
    Figure figure(style);
    figure.title(run.title());
    std::vector<LegendEntry> legend;
    const auto marker = [&](std::size_t w) { return series_marker(w, 0.2 * figure.font()); };
    for (std::size_t w = 0; w < coordinates.front().second.size(); ++w)
        legend.push_back({coordinates.front().second[w].name, LegendEntry::Kind::marker, marker(w), {}});
    figure.legend(legend);
    for (auto& [name, waves] : coordinates) {
        std::array<double, 2> y{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
        for (Wave& wave : waves) {
            std::sort(wave.points.begin(), wave.points.end());
            for (const auto& point : wave.points) {
                for (const double value : {point[1], point[2]}) {
                    if (std::isfinite(value)) y = {std::min(y[0], value), std::max(y[1], value)};
                }
            }
        }
        orbits::SeriesCoordinate coordinate = coordinate_of(model, name);
        coordinate.angle = false;
        Panel panel(figure, figure.row(0.6 * figure.width()), linear_axis("share of the orbit", "", 0.0, 1.0),
                    plot_axis(coordinate, y[0], y[1], 5));
        panel.open();
        for (std::size_t w = 0; w < waves.size(); ++w) {
            std::array<std::vector<double>, 3> columns;
            std::array<std::vector<double>, 2> shown;
            const std::size_t every = stride(waves[w].points.size(), 60);
            for (std::size_t k = 0; k < waves[w].points.size(); ++k) {
                for (std::size_t c = 0; c < 3; ++c)
                    columns[c].push_back(waves[w].points[k][c]);
                if (k % every != 0) continue;
                shown[0].push_back(waves[w].points[k][0]);
                shown[1].push_back(waves[w].points[k][1]);
            }
            panel.curve(columns[0], columns[2], {marker(w).colour, 0.9});
            panel.markers(shown[0], shown[1], series_marker(w, 0.16 * figure.font()), Panel::Filling::open);
        }
        panel.frame();
    }
    return figure.svg("Steady states", "measured (markers) and computed (lines) over one turn of the orbit");
}

}  // namespace orbid::apps::catalog
