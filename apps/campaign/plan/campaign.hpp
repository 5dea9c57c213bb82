#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

namespace orbid::apps {

/// As campaigns write them, in the order of Campaign::Kind.
inline const std::vector<std::string> campaign_kind_names{"sweep",        "coverage",       "bootstrap",
                                                          "profile_grid", "compare_models", "records"};

/// A job that tasks are made from.
struct BaseJob {
    std::string name;              ///< of the row in tables; empty: the only one
    std::string text;              ///< JSON with comments
    std::filesystem::path source;  ///< absolute: relative paths in the job start at its folder
};

/// What varies by a list: keys of the job that take their values together, setting by setting.
struct VariedFactor {
    std::vector<std::string> names;     ///< columns in tables, one per key
    std::vector<std::string> pointers;  ///< JSON Pointers into the job
    /// [setting][key]
    std::vector<std::vector<nlohmann::ordered_json>> settings;
    bool multiplied = false;  ///< settings are numbers by which all numbers of the job at that key are multiplied
};

/// What is drawn anew for every replicate.
struct VariedDraw {
    enum class Distribution { uniform, log_uniform, normal };
    std::string name;
    std::string pointer;
    Distribution distribution = Distribution::uniform;
    double first = 0.0;   ///< lower end; normal: mean
    double second = 1.0;  ///< upper end; normal: sd
};

/// A known value of a parameter.
struct KnownValue {
    std::string parameter;
    double truth = 0.0;
    double bound = std::numeric_limits<double>::quiet_NaN();  ///< least sd of any estimate; nan: not known
};

/// A campaign as plain data: all files named are found, all lists written out. Tasks: every job with every combination
/// of settings, each so many times.
struct Campaign {
    enum class Kind { sweep, coverage, bootstrap, profile_grid, compare_models, records };

    std::string title;
    Kind kind = Kind::sweep;
    std::vector<BaseJob> jobs;
    std::vector<VariedFactor> factors;
    std::vector<VariedDraw> draws;
    std::uint64_t seed = 1;  ///< of the first replicate; the next ones follow
    std::int64_t replicates = 1;
    bool seeded = false;                                    ///< jobs take the replicate's seed
    bool resampled = false;                                 ///< recorded data are resampled from those of the job
    std::vector<std::string> held;                          ///< parameters that are not estimated: those of a grid
    std::vector<std::pair<std::string, KnownValue>> known;  ///< by name of the job ("": any)
    double seconds = 0.0;                                   ///< longest time of a task [s]; 0: no limit

    /// All of it as JSON: what decides the tasks and nothing else.
    [[nodiscard]] nlohmann::ordered_json document() const;
    /// The inverse.
    /// @throws std::runtime_error when the document is not one of a campaign.
    [[nodiscard]] static Campaign from_document(const nlohmann::ordered_json& document);
};

}  // namespace orbid::apps
