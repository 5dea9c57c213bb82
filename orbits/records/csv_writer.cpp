#include <cerrno>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <system_error>

#include <fmt/format.h>

#include "models/system/stopped.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::orbits {
namespace {

/// Text in quotes where a reader would take it apart otherwise.
std::string cell(const std::string& text) {
    refuse_if(text.find_first_of("\r\n") != std::string::npos,
              "\"{}\" holds a line break and cannot be a cell of a table", text);
    const bool plain = !text.empty() && text.find_first_of(",;\t\" #") == std::string::npos;
    if (plain) return text;
    std::string quoted = "\"";
    for (const char c : text) {
        if (c == '"') quoted += '"';
        quoted += c;
    }
    return quoted + '"';
}

void append_number(fmt::memory_buffer& out, double value, const Segment& segment, Eigen::Index k) {
    if (std::isnan(value)) return;
    if (!std::isfinite(value)) {
        throw std::invalid_argument(
            fmt::format("segment \"{}\", point {}: an infinite value cannot be stored", segment.label, k));
    }
    fmt::format_to(std::back_inserter(out), "{}", value);
}

std::string header_of(const Series& series) {
    std::set<std::string> names{"segment", "t"};
    std::string header = series.timed() ? "segment,t" : "segment";
    for (const SeriesCoordinate& coordinate : series.coordinates) {
        if (!names.insert(coordinate.name).second) {
            throw std::invalid_argument(
                fmt::format("coordinate {} cannot be a column: the name is taken", coordinate.name));
        }
        header += ',' + cell(coordinate.name);
    }
    return header + '\n';
}

}  // namespace

void write_csv(const std::filesystem::path& file, const Series& series, const std::function<bool()>& interrupted) {
    struct Closer {
        void operator()(std::FILE* stream) const { std::fclose(stream); }
    };
    const std::string header = header_of(series);
    refuse_if(series.origin.find_first_of("\r\n") != std::string::npos, "origin of a series must be one line of text");
    std::unique_ptr<std::FILE, Closer> stream(std::fopen(file.c_str(), "wb"));
    const auto system = [](int error) { return std::generic_category().message(error); };
    if (!stream) throw DataError(fmt::format("{}: cannot be opened for writing: {}", file.string(), system(errno)));
    int failed = 0;  ///< the first error
    const auto flush = [&](fmt::memory_buffer& text) {
        models::stop_if_asked(interrupted);
        if (failed == 0 && std::fwrite(text.data(), 1, text.size(), stream.get()) != text.size()) failed = errno;
        text.clear();
    };

    constexpr std::size_t chunk = 1 << 20;  // bytes between two writes: large enough that they cost nothing
    const bool timed = series.timed();
    fmt::memory_buffer text;
    if (!series.origin.empty()) text.append("# origin: " + series.origin + '\n');
    text.append(header);
    for (const Segment& segment : series.segments) {
        const std::string label = cell(segment.label);
        for (Eigen::Index k = 0; k < segment.values.cols(); ++k) {
            text.append(label);
            if (timed) {
                text.push_back(',');
                append_number(text, segment.times[k], segment, k);
            }
            for (Eigen::Index i = 0; i < segment.values.rows(); ++i) {
                text.push_back(',');
                append_number(text, segment.values(i, k), segment, k);
            }
            text.push_back('\n');
            if (text.size() >= chunk) flush(text);
        }
    }
    flush(text);
    if (failed == 0 && std::fflush(stream.get()) != 0) failed = errno;
    if (failed != 0) throw DataError(fmt::format("{}: cannot be written: {}", file.string(), system(failed)));
}

std::string read_origin(const std::filesystem::path& file) {
    if (file.extension() != ".csv") return read_hdf5(file).origin;
    constexpr std::string_view mark = "# origin: ";  // as write_csv puts it, on the first line
    std::ifstream in(file, std::ios::binary);
    if (!in)
        throw DataError(fmt::format("{}: cannot be opened: {}", file.string(), std::generic_category().message(errno)));
    std::string line;
    std::getline(in, line);
    return line.starts_with(mark) ? line.substr(mark.size()) : std::string();
}

TableLayout table_layout(const Series& series) {
    TableLayout layout;
    layout.sampling = series.sampling;
    layout.phase = series.phase;
    layout.segment = "segment";
    if (series.timed()) layout.time = std::string("t");
    for (const SeriesCoordinate& coordinate : series.coordinates)
        layout.coordinates.push_back({coordinate, coordinate.name, coordinate.unit, 1.0, 0.0, {}});
    return layout;
}

}  // namespace orbid::orbits
