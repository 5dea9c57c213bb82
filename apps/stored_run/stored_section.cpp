#include "apps/stored_run/stored_section.hpp"

#include "apps/job/data_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/stages/searched_section.hpp"

namespace orbid::apps {

std::optional<SectionPoints> section_points(const StoredRun& run) {
    const Job job = stored_job(run);
    const std::size_t experiment = job.orbits ? job.orbits->data : 0;
    if (experiment >= job.data.size()) return std::nullopt;
    const auto record = stored_series(run, experiment);
    if (!record) return std::nullopt;
    std::optional<SearchedSection> searched;
    if (job.orbits && !job.orbits->file) searched = searched_section(job, *record, run.interrupted);
    const orbits::Series& series = searched ? searched->series() : *record;
    if (series.sampling != orbits::Series::Sampling::section || series.dimension() < 2) return std::nullopt;
    return section_points(series, 0, 1, run.interrupted);
}

}  // namespace orbid::apps
