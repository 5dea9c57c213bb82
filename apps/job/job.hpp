#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apps/job/model_job.hpp"
#include "apps/job/optional_block.hpp"

namespace orbid::apps {

// Blocks by name: who uses one includes its header.
struct DataJob;
struct OrbitsJob;
struct PeriodicJob;
struct EstimateJob;

/// A section of an autonomous flow: coordinate = value, crossed in one direction.
struct SectionPlaneJob {
    Eigen::Index coordinate = 0;
    double value = 0.0;
    int direction = 1;  ///< +1 while the coordinate rises, -1 while it falls
};

struct ReferenceJob {
    std::string name;  ///< of a parameter of the model or a derived quantity
    double value;
};

enum class SeriesOutput { h5, csv, none };

/// As jobs write them, in the order of SeriesOutput.
inline const std::vector<std::string> series_output_names{"h5", "csv", "none"};

/// A job file as plain data: every name resolved to an index, every default filled in, every path absolute.
/// A Job from job_reader has passed all checks that need no data.
struct Job {
    Job();
    Job(const Job& other);
    Job(Job&& other) noexcept;
    Job& operator=(const Job& other);
    Job& operator=(Job&& other) noexcept;
    ~Job();

    std::filesystem::path source;  ///< absolute path of the job file
    std::string title;
    ModelJob model;
    std::uint64_t seed = 1;
    double section_phase = 0.0;                    ///< [rad], forced models
    std::optional<SectionPlaneJob> section_plane;  ///< autonomous models
    bool section_from_data = false;                ///< autonomous models: the plane is chosen by the searched record
    std::vector<DataJob> data;
    OptionalBlock<OrbitsJob> orbits;
    OptionalBlock<PeriodicJob> periodic;
    OptionalBlock<EstimateJob> estimate;
    std::vector<ReferenceJob> reference;
    SeriesOutput series_output = SeriesOutput::h5;
    FlowStepper stepper = FlowStepper::verner;  ///< model.system takes its steps
};

}  // namespace orbid::apps
