#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>

#include <boost/math/distributions/normal.hpp>

#include "apps/catalog_plots.hpp"
#include "apps/figure.hpp"
#include "orbits/data_error.hpp"

/// Record by record: residuals, their distribution, observed against predicted.
namespace orbid::apps::catalog {

namespace {

using Json = StoredRun::Json;

/// What a record was compared with.
enum class Source { cycle, series };

/// Records of one coordinate, from one kind of source.
struct Group {
    Source source;
    std::string coordinate;
    std::vector<const ResidualRow*> rows;
};

bool is_cycle(const ResidualRow& row) {
    return row.block.starts_with("cycle ");
}

std::vector<ResidualRow> rows_of(const StoredRun& run) {
    auto rows = stored_residuals(run);
    if (rows.empty()) throw orbits::DataError((run.folder / "residuals.csv").string() + ": holds no records");
    return rows;
}

std::vector<Group> groups_of(const std::vector<ResidualRow>& rows) {
    std::vector<Group> groups;
    for (const ResidualRow& row : rows) {
        const Source source = is_cycle(row) ? Source::cycle : Source::series;
        auto found = std::find_if(groups.begin(), groups.end(), [&](const Group& group) {
            return group.source == source && group.coordinate == row.coordinate;
        });
        if (found == groups.end()) found = groups.insert(groups.end(), Group{source, row.coordinate, {}});
        found->rows.push_back(&row);
    }
    return groups;
}

/// (observed - predicted) / sd; nan when one is not known.
double normalised(const ResidualRow& row) {
    return row.sd > 0.0 ? (row.observed - row.predicted) / row.sd : std::numeric_limits<double>::quiet_NaN();
}

/// Unit of the model's time as far as its parameters tell: "s", or nothing when none of them has seconds.
std::string time_unit(const ModelJob& model) {
    const auto has_seconds = [](std::string_view unit) {
        for (std::size_t k = 0; k < unit.size(); ++k) {
            const bool begins = k == 0 || std::isalpha(static_cast<unsigned char>(unit[k - 1])) == 0;
            const bool ends = k + 1 == unit.size() || std::isalpha(static_cast<unsigned char>(unit[k + 1])) == 0;
            if (unit[k] == 's' && begins && ends) return true;
        }
        return false;
    };
    for (const auto& parameter : model.system->parameters()) {
        if (has_seconds(parameter.unit)) return "s";
    }
    for (const auto& coordinate : model.system->coordinates()) {
        if (has_seconds(coordinate.unit)) return "s";
    }
    return {};
}

orbits::SeriesCoordinate coordinate_of(const ModelJob& model, const std::string& name) {
    const Eigen::Index index = model.system->coordinate_index(name);
    if (index < 0) return {name, "", false};
    const auto& coordinate = model.system->coordinates()[static_cast<std::size_t>(index)];
    return {name, coordinate.unit == "1" ? std::string() : std::string(coordinate.unit), coordinate.angle};
}

/// Every k-th of a list, so that at most `most` are left.
std::size_t stride(std::size_t count, std::size_t most) {
    return std::max<std::size_t>(1, (count + most - 1) / most);
}

/// Whether the records of a series have times; a section of a forced system has phases.
bool is_sampled(const StoredRun& run, const std::string& experiment) {
    for (const Json* one : run.experiments()) {
        if (one->value("name", std::string()) != experiment) continue;
        if (one->contains("kind")) return (*one)["kind"] == "samples";
        return one->contains("simulate") && (*one)["simulate"].contains("samples");
    }
    return true;
}

std::string place_label(const StoredRun& run, const Group& group, const ModelJob& model, std::string& unit) {
    if (group.source == Source::cycle) return "record, cycle by cycle";
    if (is_sampled(run, group.rows.front()->experiment)) {
        unit = time_unit(model);
        return "t";
    }
    return "record";
}

std::string group_name(const Group& group, bool both) {
    const std::string name = display_name(group.coordinate);
    return both ? name + (group.source == Source::cycle ? ", cycles" : ", series") : name;
}

bool has_both(const std::vector<Group>& groups) {
    return std::any_of(groups.begin(), groups.end(), [](const Group& g) { return g.source == Source::cycle; }) &&
           std::any_of(groups.begin(), groups.end(), [](const Group& g) { return g.source == Source::series; });
}

}  // namespace

bool has_residuals(const StoredRun& run) {
    std::error_code missing;
    // A header alone has fewer bytes.
    constexpr std::uintmax_t header = 90;
    const auto bytes = std::filesystem::file_size(run.folder / "residuals.csv", missing);
    return !missing && bytes > header;
}

std::string residuals(const StoredRun& run, const PlotStyle& style) {
    const auto rows = rows_of(run);
    const auto groups = groups_of(rows);
    const bool both = has_both(groups);
    const ModelJob model = stored_model(run);
    Figure figure(style);
    figure.title(run.title());
    double reach = 3.0;
    std::size_t outside = 0;
    std::size_t known = 0;
    for (const ResidualRow& row : rows) {
        const double z = normalised(row);
        if (!std::isfinite(z)) continue;
        ++known;
        if (std::abs(z) > 2.0) ++outside;
        reach = std::max(reach, std::abs(z));
    }
    const double range = std::min(1.08 * reach, 12.0);
    const PlotAxis y = linear_axis("residual / sd", "", -range, range, 4);
    for (std::size_t g = 0; g < groups.size(); ++g) {
        const Group& group = groups[g];
        std::string unit;
        const std::string label = place_label(run, group, model, unit);
        std::string unit_below;
        const bool last = g + 1 == groups.size() || place_label(run, groups[g + 1], model, unit_below) != label;
        const bool timed = label == "t";
        // By experiment and segment, so that those of several have different colours.
        std::map<std::string, std::array<std::vector<double>, 2>> parts;
        std::vector<std::string> order;
        std::array<double, 2> ends{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
        const std::size_t every = stride(group.rows.size(), 4000);
        for (std::size_t k = 0; k < group.rows.size(); ++k) {
            const ResidualRow& row = *group.rows[k];
            const double at = timed ? row.at : static_cast<double>(k + 1);
            ends = {std::min(ends[0], at), std::max(ends[1], at)};
            const double z = normalised(row);
            // Thinned, but never of what stands out.
            if (k % every != 0 && !(std::abs(z) > 3.0)) continue;
            const std::string part = group.source == Source::cycle ? std::string() : row.experiment + " " + row.block;
            if (!parts.contains(part)) order.push_back(part);
            parts[part][0].push_back(at);
            parts[part][1].push_back(std::clamp(z, -range, range));
        }
        const double spare = 0.015 * (ends[1] - ends[0]);
        Panel panel(
            figure,
            figure.row(std::max(0.27 * figure.width(), 9.0 * figure.font()) + (last ? 1.4 * figure.font() : 0.0)),
            linear_axis(last ? label : std::string(), last ? unit : std::string(), ends[0] - spare, ends[1] + spare),
            y);
        panel.open();
        figure.rectangle({panel.box().left, panel.y(2.0), panel.box().right, panel.y(-2.0)}, "#eef1f5");
        panel.horizontal(0.0, {"#39424f", 0.6});
        constexpr std::array<std::string_view, 4> colours{"#0072b2", "#e69f00", "#009e73", "#8c510a"};
        // Few records as dots that are seen, many as dots that do not cover each other.
        const std::size_t shown = group.rows.size() / every;
        const double diameter = shown < 100 ? 2.6 : shown < 1000 ? 1.7 : 1.1;
        for (std::size_t p = 0; p < order.size(); ++p) {
            const auto& part = parts[order[p]];
            panel.dots(part[0], part[1], colours[p % colours.size()], diameter, 0.8);
        }
        panel.frame();
        if (groups.size() > 1) panel.tag(group_name(group, both));
    }
    return figure.svg("Residuals",
                      fmt::format("{} residuals over their sd, {} of them ({:.1f} %) beyond 2", known, outside,
                                  known > 0 ? 100.0 * static_cast<double>(outside) / static_cast<double>(known) : 0.0));
}

std::string normal_quantiles(const StoredRun& run, const PlotStyle& style) {
    const auto rows = rows_of(run);
    const auto groups = groups_of(rows);
    const bool both = has_both(groups);
    Figure figure(style);
    figure.title(run.title());
    std::vector<LegendEntry> legend;
    std::vector<std::vector<double>> sorted;
    double reach = 3.0;
    for (const Group& group : groups) {
        std::vector<double> values;
        for (const ResidualRow* row : group.rows) {
            if (const double z = normalised(*row); std::isfinite(z)) values.push_back(z);
        }
        std::sort(values.begin(), values.end());
        if (!values.empty()) reach = std::max({reach, -values.front(), values.back()});
        legend.push_back({group_name(group, both),
                          LegendEntry::Kind::marker,
                          series_marker(sorted.size(), 0.2 * figure.font()),
                          {}});
        sorted.push_back(std::move(values));
    }
    figure.legend(legend);
    const boost::math::normal standard;
    double widest = 2.5;
    for (const auto& values : sorted) {
        if (values.size() > 1) {
            const double last = 1.0 - 0.5 / static_cast<double>(values.size());
            widest = std::max(widest, 1.08 * boost::math::quantile(standard, last));
        }
    }
    const double range = std::min(1.08 * reach, 12.0);
    Panel panel(figure, figure.row(0.8 * figure.width()), linear_axis("normal quantile", "", -widest, widest, 7),
                linear_axis("residual / sd", "", -range, range, 7));
    panel.open();
    panel.curve(std::array{-20.0, 20.0}, std::array{-20.0, 20.0}, {"#39424f", 0.6});
    for (std::size_t g = 0; g < sorted.size(); ++g) {
        const auto count = static_cast<double>(sorted[g].size());
        std::vector<double> x;
        std::vector<double> y;
        double last = -std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < sorted[g].size(); ++k) {
            // Plotting positions of Hazen; markers nearer than 0.02 cover each other.
            const double quantile = boost::math::quantile(standard, (static_cast<double>(k) + 0.5) / count);
            if (quantile - last < 0.02) continue;
            last = quantile;
            x.push_back(quantile);
            y.push_back(std::clamp(sorted[g][k], -range, range));
        }
        panel.markers(x, y, series_marker(g, 0.16 * figure.font()), Panel::Filling::plain);
    }
    panel.frame();
    return figure.svg("Normal quantiles", "residuals over their sd against quantiles of the normal distribution");
}

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
