#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "orbits/records/series.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::orbits {

/// A record that is read piece by piece, because it need not fit into memory.
class SeriesStream {
public:
    virtual ~SeriesStream() = default;

    /// Everything about the record except its points: `segments` is empty.
    [[nodiscard]] virtual const Series& header() const = 0;
    /// Points of each segment, in order.
    [[nodiscard]] virtual const std::vector<std::size_t>& lengths() const = 0;
    [[nodiscard]] virtual bool timed() const = 0;

    /// Points first, ..., first + count - 1 of all segments one after the other; a new segment wherever the record has
    /// one. Fewer where the record ends. With first = 0 and count = size() the segments are those of the record.
    /// @throws DataError when they cannot be read, naming where; models::Stopped.
    [[nodiscard]] virtual std::vector<Segment> read(std::size_t first, std::size_t count) const = 0;

    [[nodiscard]] std::size_t size() const;  ///< points of all segments

protected:
    SeriesStream() = default;
    SeriesStream(const SeriesStream&) = default;
    SeriesStream& operator=(const SeriesStream&) = default;
};

/// Opens what write_hdf5 wrote. The file must stay as it is while it is read.
/// @param interrupted  asked while reading; if it says so, models::Stopped is thrown
/// @throws DataError as read_hdf5, but for what is wrong with points: those are checked when they are read.
[[nodiscard]] std::unique_ptr<SeriesStream> stream_hdf5(const std::filesystem::path& file,
                                                        std::function<bool()> interrupted = {});

/// Opens a table in text, which is read once to its end: all rows are checked, and where pieces of some 4 MB begin is
/// noted. The file must stay as it is while it is read.
/// @throws DataError as read_csv, and for a file of Matlab; std::invalid_argument as read_csv, for samples, and for a
///         layout that reads a part or sds.
[[nodiscard]] std::unique_ptr<SeriesStream> stream_csv(const std::filesystem::path& file, TableLayout layout);

/// Records of the same coordinates one after the other, each with segments of its own. At least one.
/// @throws DataError where coordinates, sampling or times differ, by the number of the record.
[[nodiscard]] std::unique_ptr<SeriesStream> joined(std::vector<std::unique_ptr<SeriesStream>> records);

}  // namespace orbid::orbits
