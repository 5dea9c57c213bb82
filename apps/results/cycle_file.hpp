#pragma once

#include <complex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "apps/documents/fingerprint.hpp"
#include "models/system/system.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// The coordinates of a system as a series of its states has them.
[[nodiscard]] std::vector<orbits::SeriesCoordinate> series_coordinates(const models::System& system);

/// The plane that an autonomous flow crosses.
struct SectionPlane {
    std::string coordinate;
    double value = 0.0;
    int direction = 1;  ///< +1 rising, -1 falling
};

/// What stands above the list in cycles.json, orbits.json and branch.json.
struct CycleFileHead {
    std::string model;
    std::vector<orbits::SeriesCoordinate> coordinates;
    std::optional<double> phase;             ///< of the section [rad]; forced models only
    std::optional<SectionPlane> plane = {};  ///< of autonomous models
    std::optional<double> forcing_period_s;  ///< gives the `time` of a cycle: period times this
    Fingerprint fingerprint;                 ///< left out of the file when its hash is empty
    bool own_time = false;                   ///< autonomous models: T of an orbit is a result
};

/// A list of cycles with what is known of its origin.
struct CycleFile {
    CycleFileHead head;
    orbits::CycleSearch search;
};

/// Content of cycles.json, format orbid-cycles/1. Undefined numbers and absent covariances
/// are null; numbers read back to the bit.
///
/// Beside the keys of the contract: `fingerprint`, `missing`, `candidates`, `rejected`, `spline_map`,
/// `reading_covariance`, `remarks`; of a cycle `time_sd`, `time_covariance` and `code`.
/// @throws std::invalid_argument when a cycle's shapes do not fit its period and the coordinates.
[[nodiscard]] std::string cycles_text(const CycleFile& file);

namespace detail {

/// What stands above the list, without a list.
[[nodiscard]] nlohmann::ordered_json head_document(const CycleFileHead& head);
/// [re, im]
[[nodiscard]] nlohmann::ordered_json complex_pair(std::complex<double> value);
/// [[re, im], ...]
[[nodiscard]] nlohmann::ordered_json complex_pairs(const std::vector<std::complex<double>>& values);
/// Rows of a matrix; null when it is empty (not known).
[[nodiscard]] nlohmann::ordered_json rows_or_null(const Eigen::MatrixXd& matrix);
/// @throws std::invalid_argument unless points has shape (dimension, period), period >= 1; names the cycle's index.
void require_points(const Eigen::MatrixXd& points, int period, std::size_t dimension, std::size_t index);
/// @throws std::invalid_argument unless a matrix is empty or has that shape.
void require_shape(const Eigen::MatrixXd& matrix, Eigen::Index height, Eigen::Index width, std::string_view what,
                   std::size_t index);
/// period times that of the forcing; null without one.
[[nodiscard]] nlohmann::ordered_json time_of(const CycleFileHead& head, int period);

}  // namespace detail

}  // namespace orbid::apps
