#include "apps/program/cycle_run.hpp"

#include <ostream>

#include "apps/drawing/chart_picture.hpp"
#include "apps/drawing/section_plot.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/program/summary.hpp"
#include "apps/results/invariants_file.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "apps/stages/searched_section.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

/// The section that is searched for cycles, cut from samples if need be.
SearchedSection section_of(const Workspace& work, const Experiment& experiment) {
    const RunStop::AtOnce leaving(work.stop);
    work.progress.within("section of the samples");
    SearchedSection section = searched_section(work.job, experiment.series, work.asking());
    section.stream = experiment.stream;
    if (section.stream)
        section.memory = static_cast<std::size_t>(1e6 * work.job.data[work.job.orbits->data].file->stream_memory);
    work.progress.within({});
    return section;
}

void store_picture(const Workspace& work, const orbits::Series& section, const orbits::CycleSearch& search) {
    if (section.dimension() < 2) return;
    SectionPicture picture{section_points(section), {}, work.job.title, ""};
    if (work.job.title.empty()) picture.title = "Section and periodic points";
    for (const orbits::Cycle& cycle : search.cycles)
        picture.add_orbit(cycle.period, cycle.points);
    work.folder.store("section.svg", chart_svg(section_chart(picture), picture.title, run_picture_style));
}

}  // namespace

bool wants(const RunOptions& options, Stage stage) {
    return options.stage == Stage::all || options.stage == stage;
}

bool is_section_search(const Job& job) {
    return job.orbits && !job.orbits->file;
}

JobCycles job_cycles(const Workspace& work, const std::vector<Experiment>& data, const Console& console) {
    const Job& job = work.job;
    JobCycles cycles;
    if (is_section_search(job)) cycles.section = section_of(work, data[job.orbits->data]);
    cycles.search = load_cycles(work, cycles.section);
    if (wants(work.options, Stage::orbits)) console.out << cycles_summary(cycles.search);
    const auto& section = cycles.section;
    if (section && job.orbits->invariants && !work.interruption.asked())
        console.out << invariants_summary(compute_invariants(work, *section, cycles.search));
    if (section && section->stream) {
        // What shows a section is a small part of it.
        constexpr std::size_t shown = 1 << 16;
        orbits::Series part = section->series();
        part.segments = section->stream->read(0, shown);
        store_picture(work, part, cycles.search);
    } else if (section) {
        store_picture(work, section->series(), cycles.search);
    }
    return cycles;
}

void find_needed_cycles(const Workspace& work, const std::vector<Experiment>& data, const Console& console,
                        JobCycles& cycles) {
    try {
        cycles = job_cycles(work, data, console);
    } catch (const orbits::DataError& error) {
        work.progress.end(error.what());
    }
}

void store_section(const Workspace& work, const std::vector<Experiment>& data) {
    const orbits::Series& series = data[work.job.orbits->data].series;
    // Of crossings one coordinate is that of the plane.
    if (!work.job.section_plane && series.sampling == orbits::Series::Sampling::section)
        store_picture(work, series, {});
}

}  // namespace orbid::apps
