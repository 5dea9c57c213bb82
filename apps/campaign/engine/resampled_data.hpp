#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

namespace orbid::apps {

/// Records drawn anew from a finished run: each reading is what the run predicts plus an error. Errors are those of the
/// run in blocks of consecutive readings (estimator/exploration/block_resampling.hpp), so that what is correlated stays
/// correlated; their mean is taken off, and they are scaled to the sd that the run estimates.
class ResampledData {
public:
    /// @param run  folder of the run: its residuals.csv.
    /// @throws std::runtime_error when there is none, or it holds no readings of records.
    explicit ResampledData(const std::filesystem::path& run);

    /// Puts new records in the place of those of a job; they are written into a folder that must exist.
    /// @param job  the complete job of the run.
    void put_into(nlohmann::ordered_json& job, std::uint64_t seed, const std::filesystem::path& folder) const;

private:
    /// Readings of one coordinate of a segment, in time.
    struct Course {
        std::vector<std::string> times;  ///< as the file has them
        std::vector<double> predicted;
        std::vector<double> sds;
        std::vector<double> errors;  ///< over their sds, with mean 0 and mean square 1
        std::size_t block = 1;       ///< length of the blocks that they are drawn in
    };
    using Segment = std::map<std::string, Course>;                  ///< by coordinate
    using Segments = std::vector<std::pair<std::string, Segment>>;  ///< by label, in the order of the file

    void add(const std::vector<std::string>& cells);
    [[nodiscard]] std::string table(const Segments& segments, const std::vector<std::string>& coordinates,
                                    std::uint64_t seed, std::uint64_t& stream) const;

    std::map<std::string, Segments> experiments_;
    std::map<std::string, std::vector<std::string>> coordinates_;  ///< of an experiment, in the order of the file
};

}  // namespace orbid::apps
