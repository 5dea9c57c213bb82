#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "orbits/records/hdf5_objects.hpp"
#include "orbits/records/series_file.hpp"
#include "orbits/records/series_stream.hpp"

namespace orbid::orbits {

namespace {

class Hdf5Stream final : public SeriesStream {
public:
    Hdf5Stream(const std::filesystem::path& file, std::function<bool()> interrupted)
        : interrupted_(std::move(interrupted)), read_(file, interrupted_) {
        const Hdf5Silence silence;
        file_ = opened_file(read_, file);
        const Hdf5Handle root(H5Gopen2(file_.id(), "/", H5P_DEFAULT), H5Gclose);
        read_header(read_, root.id(), header_);
        // Crossings of a section may have been timed.
        timed_ = header_.sampling == Series::Sampling::samples || H5Lexists(file_.id(), "times", H5P_DEFAULT) > 0;
        const std::size_t segments = read_.members(file_.id(), "segments");
        for (std::size_t s = 0; s < segments; ++s) {
            const std::string path = values_path(s);
            const auto shape = read_.shape(read_.open_dataset(file_.id(), path));
            if (shape.size() != 2 || shape[1] != static_cast<hsize_t>(header_.dimension()))
                read_.fail(fmt::format("dataset \"{}\" has shape ({}), must be (points, {}): one column per coordinate",
                                       path, fmt::join(shape, ", "), header_.dimension()));
            read_.need_room_for_numbers(path, shape);
            lengths_.push_back(static_cast<std::size_t>(shape[0]));
        }
    }

    [[nodiscard]] const Series& header() const override { return header_; }
    [[nodiscard]] const std::vector<std::size_t>& lengths() const override { return lengths_; }
    [[nodiscard]] bool timed() const override { return timed_; }

    /// Of all segments.
    /// @throws DataError if there are fewer
    void need(std::size_t points) const {
        if (size() < points) read_.fail(fmt::format("has {} points, at least {} are needed", size(), points));
    }

    [[nodiscard]] std::vector<Segment> read(std::size_t first, std::size_t count) const override {
        models::stop_if_asked(interrupted_);
        const Hdf5Silence silence;
        std::vector<Segment> segments;
        const std::size_t last = first + std::min(count, size() - std::min(first, size()));
        std::size_t begin = 0;  // of segment s
        for (std::size_t s = 0; s < lengths_.size() && begin <= last; begin += lengths_[s++]) {
            const std::size_t from = std::max(first, begin), to = std::min(last, begin + lengths_[s]);
            const bool empty_inside = lengths_[s] == 0 && begin >= first;
            if (from < to || empty_inside) segments.push_back(part(s, from - begin, to - from));
        }
        return segments;
    }

private:
    static std::string values_path(std::size_t s) { return fmt::format("segments/{:06}", s); }

    [[nodiscard]] Segment part(std::size_t s, std::size_t first, std::size_t count) const {
        Segment segment;
        const std::string path = values_path(s);
        const Hdf5Handle values = read_.open_dataset(file_.id(), path);
        const Eigen::Index n = header_.dimension();
        const auto points = static_cast<Eigen::Index>(count);
        segment.values.resize(n, points);
        read_.rows(values, path, read_.shape(values), first, count, segment.values.data());
        for (Eigen::Index k = 0; k < points; ++k)
            for (Eigen::Index i = 0; i < n; ++i)
                if (std::isinf(segment.values(i, k)))
                    read_.fail(fmt::format("dataset \"{}\", point {}: infinite value; a missing sample is nan", path,
                                           first + static_cast<std::size_t>(k)));
        segment.label = read_.text(values.id(), "label");
        if (timed_) read_times(s, first, segment);
        return segment;
    }

    void read_times(std::size_t s, std::size_t first, Segment& segment) const {
        const std::string path = fmt::format("times/{:06}", s);
        const Hdf5Handle times = read_.open_dataset(file_.id(), path);
        const auto shape = read_.shape(times);
        if (shape.size() != 1 || shape[0] != lengths_[s])
            read_.fail(fmt::format("dataset \"{}\" has shape ({}), must be ({}): one time per point", path,
                                   fmt::join(shape, ", "), lengths_[s]));
        const Eigen::Index points = segment.values.cols();
        segment.times.resize(points);
        read_.rows(times, path, shape, first, static_cast<hsize_t>(points), segment.times.data());
        for (Eigen::Index k = 0; k < points; ++k)
            if (!std::isfinite(segment.times[k]) || (k > 0 && !(segment.times[k] > segment.times[k - 1])))
                read_.fail(fmt::format("dataset \"{}\", point {}: times must be finite and ascend", path,
                                       first + static_cast<std::size_t>(k)));
    }

    std::function<bool()> interrupted_;
    Hdf5Reader read_;
    Hdf5Handle file_;
    Series header_;
    std::vector<std::size_t> lengths_;
    bool timed_ = false;
};

}  // namespace

std::unique_ptr<SeriesStream> stream_hdf5(const std::filesystem::path& file, std::function<bool()> interrupted) {
    return std::make_unique<Hdf5Stream>(file, std::move(interrupted));
}

Series read_hdf5(const std::filesystem::path& file, std::size_t minimum_points,
                 const std::function<bool()>& interrupted) {
    const Hdf5Stream stream(file, interrupted);
    stream.need(minimum_points);
    Series series = stream.header();
    series.segments = stream.read(0, stream.size());
    return series;
}

}  // namespace orbid::orbits
