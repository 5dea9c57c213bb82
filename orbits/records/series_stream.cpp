#include "orbits/records/series_stream.hpp"

#include <numeric>

namespace orbid::orbits {

std::size_t SeriesStream::size() const {
    return std::accumulate(lengths().begin(), lengths().end(), std::size_t{0});
}

}  // namespace orbid::orbits
