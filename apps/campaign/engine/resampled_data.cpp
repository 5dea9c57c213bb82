#include "apps/campaign/engine/resampled_data.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "estimator/exploration/block_resampling.hpp"
#include "estimator/interface/random_stream.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

enum Column { experiment, segment, coordinate, time, observed, predicted, sd, columns };

/// Cells of a line of CSV; quoted cells may hold commas and doubled quotes, as result files write them.
std::vector<std::string> cells_of(std::string_view line) {
    std::vector<std::string> cells(1);
    bool quoted = false;
    for (std::size_t i = 0; i < line.size(); ++i) {
        if (line[i] == '"') {
            if (quoted && i + 1 < line.size() && line[i + 1] == '"')
                cells.back() += line[++i];
            else
                quoted = !quoted;
        } else if (line[i] == ',' && !quoted) {
            cells.emplace_back();
        } else {
            cells.back() += line[i];
        }
    }
    return cells;
}

double number(const std::string& cell) {
    double value = std::nan("");
    (void)std::from_chars(cell.data(), cell.data() + cell.size(), value);
    return value;
}

}  // namespace

ResampledData::ResampledData(const std::filesystem::path& run) {
    const std::filesystem::path file = run / "residuals.csv";
    if (!std::filesystem::is_regular_file(file))
        throw std::runtime_error(
            fmt::format("{} does not exist: the errors of a run with recorded data are taken from it", file.string()));
    const std::string text = read_whole_file(file);
    for (std::size_t begin = text.find('\n') + 1; begin < text.size();) {
        const std::size_t end = std::min(text.find('\n', begin), text.size());
        add(cells_of(std::string_view(text).substr(begin, end - begin)));
        begin = end + 1;
    }
    if (experiments_.empty()) throw std::runtime_error(fmt::format("{} holds no residuals", file.string()));
    for (auto& [experiment_name, segments] : experiments_)
        for (auto& [label, courses] : segments)
            for (auto& [coordinate_name, course] : courses)
                if (estimator::standardise(course.errors))
                    course.block = estimator::block_length({course.errors});
                else
                    throw std::runtime_error(
                        fmt::format("{}: {} of {} has no errors with a known sd: only runs with a series or waveform "
                                    "residual can be "
                                    "drawn anew",
                                    file.string(), coordinate_name, experiment_name));
}

void ResampledData::add(const std::vector<std::string>& cells) {
    if (cells.size() < columns) return;
    Segments& segments = experiments_[cells[experiment]];
    // Mostly that of the row before.
    auto found = std::find_if(segments.rbegin(), segments.rend(),
                              [&](const auto& each) { return each.first == cells[segment]; });
    if (found == segments.rend()) {
        segments.emplace_back(cells[segment], Segment{});
        found = segments.rbegin();
    }
    std::vector<std::string>& names = coordinates_[cells[experiment]];
    if (std::find(names.begin(), names.end(), cells[coordinate]) == names.end()) names.push_back(cells[coordinate]);
    Course& course = found->second[cells[coordinate]];
    course.times.push_back(cells[time]);
    course.predicted.push_back(number(cells[predicted]));
    course.sds.push_back(number(cells[sd]));
    course.errors.push_back((number(cells[observed]) - course.predicted.back()) / course.sds.back());
}

std::string ResampledData::table(const Segments& segments, const std::vector<std::string>& coordinates,
                                 std::uint64_t seed, std::uint64_t& stream) const {
    std::string text = "segment,time";
    for (const std::string& name : coordinates)
        text += "," + name;
    text += '\n';
    for (const auto& [label, segment] : segments) {
        // Rows by time: a coordinate that was not read at a time leaves its cell empty.
        std::map<double, std::pair<std::string, std::map<std::string, double>>> rows;
        for (const auto& [name, course] : segment) {
            const std::size_t count = course.errors.size();
            const auto drawn = estimator::drawn_blocks(count, count, course.block,
                                                       {seed, estimator::RandomPurpose::resampling, stream++});
            for (std::size_t i = 0; i < count; ++i) {
                auto& row = rows[number(course.times[i])];
                row.first = course.times[i];
                row.second[name] = course.predicted[i] + course.sds[i] * course.errors[drawn[i]];
            }
        }
        for (const auto& [at, row] : rows) {
            text += fmt::format("\"{}\",{}", label, row.first);
            for (const std::string& name : coordinates) {
                const auto value = row.second.find(name);
                text += value == row.second.end() ? std::string(",") : fmt::format(",{}", value->second);
            }
            text += '\n';
        }
    }
    return text;
}

void ResampledData::put_into(Json& job, std::uint64_t seed, const std::filesystem::path& folder) const {
    Json& data = job["data"];
    std::uint64_t stream = 0;
    const auto replace = [&](Json& one) {
        if (!one.contains("file") && !one.contains("files")) return;
        const std::string name = one.value("name", "run");
        const auto found = experiments_.find(name);
        if (found == experiments_.end())
            throw std::runtime_error(fmt::format("residuals.csv has no readings of the experiment \"{}\"", name));
        const std::vector<std::string>& names = coordinates_.at(name);
        const std::filesystem::path file = folder / (name + ".csv");
        std::ofstream out(file, std::ios::binary);
        out << table(found->second, names, seed, stream);
        if (!out.flush()) throw std::runtime_error(fmt::format("cannot write {}", file.string()));
        for (const char* key : {"files", "sha256", "window", "rows", "every"})
            one.erase(key);
        one["file"] = file.string();
        one["missing"] = "empty";
        Json described{{"segment", "segment"}};
        if (one.value("kind", "samples") == "samples") described["time"] = "time";
        for (const std::string& each : names)
            described[each] = each;
        one["columns"] = described;
        one.erase("segments");
    };
    if (data.is_array()) {
        for (Json& one : data)
            replace(one);
    } else {
        replace(data);
    }
}

}  // namespace orbid::apps
