#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/model_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"

namespace orbid::apps {

/// A job file as plain data: every name resolved to an index, every default filled in, every path absolute.
/// A Job from job_reader has passed all checks that need no data.

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

struct Job {
    std::filesystem::path source;  ///< absolute path of the job file
    std::string title;
    ModelJob model;
    std::uint64_t seed = 1;
    double section_phase = 0.0;                    ///< [rad], forced models
    std::optional<SectionPlaneJob> section_plane;  ///< autonomous models
    std::vector<DataJob> data;
    std::optional<OrbitsJob> orbits;
    std::optional<PeriodicJob> periodic;
    std::optional<EstimateJob> estimate;
    std::vector<ReferenceJob> reference;
    SeriesOutput series_output = SeriesOutput::h5;
    FlowStepper stepper = FlowStepper::verner;  ///< model.system takes its steps
};

}  // namespace orbid::apps
