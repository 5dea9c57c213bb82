#include "orbits/records/series_stream.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <utility>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"

namespace orbid::orbits {

namespace {

class JoinedStream final : public SeriesStream {
public:
    explicit JoinedStream(std::vector<std::unique_ptr<SeriesStream>> records) : records_(std::move(records)) {
        const Series& own = header();
        for (std::size_t i = 0; i < records_.size(); ++i) {
            const Series& other = records_[i]->header();
            const bool alike = std::equal(
                other.coordinates.begin(), other.coordinates.end(), own.coordinates.begin(), own.coordinates.end(),
                [](const auto& a, const auto& b) { return a.name == b.name && a.unit == b.unit; });
            if (!alike || other.sampling != own.sampling || records_[i]->timed() != timed())
                throw DataError(fmt::format("record {} has other coordinates than those before it", i + 1));
            lengths_.insert(lengths_.end(), records_[i]->lengths().begin(), records_[i]->lengths().end());
        }
    }

    [[nodiscard]] const Series& header() const override { return records_.front()->header(); }
    [[nodiscard]] const std::vector<std::size_t>& lengths() const override { return lengths_; }
    [[nodiscard]] bool timed() const override { return records_.front()->timed(); }

    [[nodiscard]] std::vector<Segment> read(std::size_t first, std::size_t count) const override {
        std::vector<Segment> segments;
        for (const auto& record : records_) {
            const std::size_t size = record->size();
            if (first < size && count > 0) {
                const std::size_t some = std::min(count, size - first);
                auto part = record->read(first, some);
                std::move(part.begin(), part.end(), std::back_inserter(segments));
                count -= some;
                first = 0;
            } else {
                first -= std::min(first, size);
            }
        }
        return segments;
    }

private:
    std::vector<std::unique_ptr<SeriesStream>> records_;
    std::vector<std::size_t> lengths_;
};

}  // namespace

std::size_t SeriesStream::size() const {
    return std::accumulate(lengths().begin(), lengths().end(), std::size_t{0});
}

std::unique_ptr<SeriesStream> joined(std::vector<std::unique_ptr<SeriesStream>> records) {
    if (records.size() == 1) return std::move(records.front());
    return std::make_unique<JoinedStream>(std::move(records));
}

}  // namespace orbid::orbits
