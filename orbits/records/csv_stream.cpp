#include <algorithm>
#include <cerrno>
#include <fstream>
#include <ios>
#include <memory>
#include <string>
#include <system_error>
#include <unordered_set>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "models/system/stopped.hpp"
#include "orbits/records/matlab_file.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/records/series_stream.hpp"
#include "orbits/records/table_rows.hpp"

namespace orbid::orbits {

namespace {

/// Bytes of text that are read at once; longer where a line is longer.
constexpr std::size_t piece_bytes = 1 << 22;

/// Whole lines of a table.
struct Piece {
    std::streamoff begin = 0;
    std::size_t bytes = 0;
    std::size_t lines_before = 0;
    std::size_t first = 0;  ///< point
    std::size_t count = 0;  ///< points
};

void refuse_layout(const std::filesystem::path& file, const TableLayout& layout) {
    validate_layout(layout);
    refuse_if(layout.sampling == Series::Sampling::samples, "stream of {}: holds samples, must hold sections",
              file.string());
    const RecordPart whole;
    refuse_if(layout.part.first_row != whole.first_row || layout.part.last_row != whole.last_row ||
                  layout.part.windowed() || layout.part.every != 1,
              "stream of {}: a part of it is asked for, but it is read as a whole", file.string());
    refuse_if(std::any_of(layout.coordinates.begin(), layout.coordinates.end(),
                          [](const CoordinateColumn& one) { return !one.sd.empty(); }),
              "stream of {}: sds of readings are not read from streams", file.string());
    if (is_matlab_file(file))
        throw DataError(
            fmt::format("{}: a file of Matlab cannot be streamed; write it as HDF5 or text", file.string()));
}

/// Parts of one segment, one after the other, as one.
Segment whole_of(std::vector<Segment> parts) {
    if (parts.size() == 1) return std::move(parts.front());
    Eigen::Index points = 0;
    for (const Segment& part : parts)
        points += part.values.cols();
    Segment whole;
    whole.label = parts.front().label;
    whole.values.resize(parts.front().values.rows(), points);
    whole.times.resize(parts.front().times.size() > 0 ? points : 0);
    Eigen::Index at = 0;
    for (const Segment& part : parts) {
        const Eigen::Index count = part.values.cols();
        whole.values.middleCols(at, count) = part.values;
        if (whole.times.size() > 0) whole.times.segment(at, count) = part.times;
        at += count;
    }
    return whole;
}

class CsvStream final : public SeriesStream {
public:
    CsvStream(const std::filesystem::path& file, TableLayout layout) : file_(file), layout_(std::move(layout)) {
        refuse_layout(file_, layout_);
        header_series_.sampling = layout_.sampling;
        header_series_.phase = layout_.phase;
        for (const CoordinateColumn& column : layout_.coordinates)
            header_series_.coordinates.push_back(column.coordinate);
        find_pieces();
        refuse_record_if(size() < std::max<std::size_t>(layout_.minimum_points, 1),
                         "{}: has {} points, at least {} are needed", file_.string(), size(),
                         std::max<std::size_t>(layout_.minimum_points, 1));
    }

    [[nodiscard]] const Series& header() const override { return header_series_; }
    [[nodiscard]] const std::vector<std::size_t>& lengths() const override { return lengths_; }
    [[nodiscard]] bool timed() const override { return !layout_.time.empty(); }

    [[nodiscard]] std::vector<Segment> read(std::size_t first, std::size_t count) const override {
        std::vector<std::vector<Segment>> parts;
        const std::size_t last = first + std::min(count, size() - std::min(first, size()));
        auto piece = std::upper_bound(pieces_.begin(), pieces_.end(), first,
                                      [](std::size_t point, const Piece& one) { return point < one.first; });
        if (piece != pieces_.begin()) --piece;
        for (; piece != pieces_.end() && piece->first < last; ++piece) {
            std::size_t at = piece->first;
            for (Segment& own : rows_of(*piece, text_of(*piece)).series.segments) {
                const std::size_t end = at + static_cast<std::size_t>(own.values.cols());
                const std::size_t from = std::max(first, at), to = std::min(last, end);
                if (from < to) {
                    if (parts.empty() || parts.back().front().label != own.label) parts.emplace_back();
                    parts.back().push_back(part_of(std::move(own), from - at, to - from));
                }
                at = end;
            }
        }
        std::vector<Segment> segments;
        for (std::vector<Segment>& one : parts)
            segments.push_back(whole_of(std::move(one)));
        return segments;
    }

private:
    static Segment part_of(Segment whole, std::size_t first, std::size_t count) {
        const auto from = static_cast<Eigen::Index>(first), some = static_cast<Eigen::Index>(count);
        if (some == whole.values.cols()) return whole;
        Segment part;
        part.label = std::move(whole.label);
        part.values = Eigen::MatrixXd(whole.values.middleCols(from, some));
        if (whole.times.size() > 0) part.times = whole.times.segment(from, some);
        return part;
    }

    [[nodiscard]] TableRows rows_of(const Piece& piece, const std::string& text) const {
        return read_rows(TextTable(file_, header_ + text, piece.lines_before), layout_);
    }

    [[nodiscard]] std::string text_of(const Piece& piece) const {
        models::stop_if_asked(layout_.interrupted);
        std::ifstream stream(file_, std::ios::binary);
        std::string text(piece.bytes, '\0');
        stream.seekg(piece.begin);
        stream.read(text.data(), static_cast<std::streamsize>(piece.bytes));
        refuse_record_if(!stream, "{}: cannot be read any more; it must stay as it is while it is read",
                         file_.string());
        return text;
    }

    /// The lines before the first row, as they stand in the file. Text that holds no header is refused by the table.
    static std::string header_of(const std::string& text) {
        constexpr std::string_view mark = "\xEF\xBB\xBF";
        std::size_t begin = text.starts_with(mark) ? mark.size() : 0;
        while (begin < text.size()) {
            const std::size_t end = std::min(text.find('\n', begin), text.size() - 1) + 1;
            const std::string line = text.substr(begin, end - begin);
            const std::size_t content = line.find_first_not_of(" \t\r\n");
            begin = end;
            if (content != std::string::npos && line[content] != '#') break;
        }
        return text.substr(0, begin);
    }

    /// One line with the names of the columns, without what stands before it.
    void take_header(const std::string& lines) {
        const TextTable table(file_, lines.starts_with("\xEF\xBB\xBF") ? lines.substr(3) : lines);
        const std::size_t end = lines.find_last_not_of("\r\n");
        const std::size_t begin = lines.rfind('\n', end);
        header_ = lines.substr(begin == std::string::npos ? 0 : begin + 1, end + 1) + "\n";
        if (header_.starts_with("\xEF\xBB\xBF")) header_.erase(0, 3);
        header_.erase(header_.find('\n') + 1);
    }

    void find_pieces() {
        std::ifstream stream = opened();
        std::string text, rest;
        Piece piece;
        std::unordered_set<std::string> labels;
        bool begun = false;
        while (stream || !rest.empty()) {
            models::stop_if_asked(layout_.interrupted);
            text = std::move(rest);
            const std::size_t kept = text.size();
            text.resize(kept + piece_bytes);
            stream.read(text.data() + kept, static_cast<std::streamsize>(piece_bytes));
            text.resize(kept + static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0)));
            const std::size_t end = text.rfind('\n');
            const bool last = !stream;
            if (!last && end == std::string::npos) {
                rest = std::move(text);
                continue;
            }
            rest = last ? std::string() : text.substr(end + 1);
            if (!last) text.resize(end + 1);
            if (!begun) {
                const std::string lines = header_of(text);
                take_header(lines);
                begun = true;
                piece.begin = static_cast<std::streamoff>(lines.size());
                piece.lines_before = static_cast<std::size_t>(std::count(lines.begin(), lines.end(), '\n'));
                text.erase(0, lines.size());
            }
            piece.bytes = text.size();
            add(piece, rows_of(piece, text), labels);
            piece.lines_before += static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
            piece.begin += static_cast<std::streamoff>(piece.bytes);
        }
    }

    /// Notes a piece and what its rows say of segments.
    void add(const Piece& piece, const TableRows& rows, std::unordered_set<std::string>& labels) {
        if (rows.rows == 0) return;
        Piece& own = pieces_.emplace_back(piece);
        own.first = size();
        own.count = rows.series.size();
        for (const Segment& segment : rows.series.segments) {
            const auto points = static_cast<std::size_t>(segment.values.cols());
            const bool goes_on =
                &segment == &rows.series.segments.front() && !lengths_.empty() && segment.label == label_;
            if (goes_on) {
                refuse_record_if(segment.times.size() > 0 && !(segment.times[0] > time_),
                                 "{}: time {} s follows {} s in segment {}; times must ascend within a segment",
                                 file_.string(), segment.times.size() > 0 ? segment.times[0] : 0.0, time_, label_);
                lengths_.back() += points;
            } else {
                refuse_record_if(!labels.insert(segment.label).second,
                                 "{}: segment \"{}\" comes back after another one; the rows of a segment must follow "
                                 "each other, a new piece needs a new label",
                                 file_.string(), segment.label);
                lengths_.push_back(points);
            }
            label_ = segment.label;
            if (segment.times.size() > 0) time_ = segment.times[segment.times.size() - 1];
        }
    }

    [[nodiscard]] std::ifstream opened() const {
        std::error_code error;
        const auto status = std::filesystem::status(file_, error);
        refuse_record_if(!std::filesystem::exists(status), "{}: no such file", file_.string());
        refuse_record_if(std::filesystem::is_directory(status), "{}: is a folder; a file with data is needed",
                         file_.string());
        std::ifstream stream(file_, std::ios::binary);
        refuse_record_if(!stream, "{}: cannot be opened for reading: {}", file_.string(),
                         std::generic_category().message(errno));
        return stream;
    }

    std::filesystem::path file_;
    TableLayout layout_;
    Series header_series_;
    std::string header_;  ///< the line with the names of the columns
    std::vector<Piece> pieces_;
    std::vector<std::size_t> lengths_;
    std::string label_;  ///< of the last row so far
    double time_ = 0.0;  ///< likewise
};

}  // namespace

std::unique_ptr<SeriesStream> stream_csv(const std::filesystem::path& file, TableLayout layout) {
    return std::make_unique<CsvStream>(file, std::move(layout));
}

}  // namespace orbid::orbits
