#include "apps/stages/orbits_stage.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/results/cycle_reader.hpp"
#include "apps/results/invariants_file.hpp"
#include "apps/stages/short_record.hpp"
#include "apps/stages/workspace.hpp"
#include "orbits/cycle_residuals/cycle_target.hpp"
#include "orbits/cycles/streamed_search.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

Fingerprint cycles_fingerprint(const Workspace& work) {
    const OrbitsJob& orbits = *work.job.orbits;
    const std::string data = work.document.contains("data") && work.document["data"].is_array()
                                 ? fmt::format("/data/{}", orbits.data)
                                 : "/data";
    return stage_fingerprint(work.document, {"/model", "/seed", "/section", "/flow", data + "/simulate", data + "/file",
                                             data + "/files", data + "/sha256", data + "/columns", data + "/missing",
                                             data + "/step", data + "/window", data + "/rows", data + "/every",
                                             data + "/spacing", data + "/sensor", data + "/parameters", "/orbits"});
}

/// With the reason, where the search has noted it among its remarks.
void say_missing(const Workspace& work, const orbits::CycleSearch& search) {
    for (const int period : search.missing) {
        const std::string plain = fmt::format("no cycle of period {} was found", period);
        const auto reason = std::find_if(search.remarks.begin(), search.remarks.end(),
                                         [&](const std::string& remark) { return remark.starts_with(plain + ":"); });
        work.progress.say(reason != search.remarks.end() ? *reason : plain);
    }
}

/// @throws orbits::DataError naming the first cycle that lacks what its weight in the estimate needs.
void check_weights(const std::vector<orbits::Cycle>& cycles, const Job& job) {
    if (!job.estimate || !job.estimate->cycles) return;
    orbits::CycleTargetOptions targets;
    targets.weights = job.estimate->cycles->covariance ? orbits::CycleWeights::covariance : orbits::CycleWeights::equal;
    targets.positions = job.estimate->cycles->positions;
    targets.multipliers = job.estimate->cycles->multipliers;
    orbits::check_weights(cycles, targets);
}

/// Periods asked for of which a list from a file has none.
orbits::CycleSearch from_file(const Workspace& work) {
    const OrbitsJob& orbits = *work.job.orbits;
    orbits::CycleSearch search = named_cycles(work.job).search;
    try {
        check_weights(search.cycles, work.job);
    } catch (const orbits::DataError& error) {
        throw orbits::DataError(fmt::format("{}: {}", orbits.file->string(), error.what()));
    }
    search.missing.clear();
    if (work.job.estimate && work.job.estimate->cycles) {
        for (const int period : work.job.estimate->cycles->periods) {
            const bool found = std::any_of(search.cycles.begin(), search.cycles.end(),
                                           [&](const orbits::Cycle& cycle) { return cycle.period == period; });
            if (!found) search.missing.push_back(period);
        }
    }
    work.progress.reused("orbits",
                         fmt::format("{} cycles from {}", search.cycles.size(), orbits.file->filename().string()));
    return search;
}

std::string description(const SectionPlane& plane) {
    return fmt::format("{} = {}, {}", plane.coordinate, plane.value, plane.direction > 0 ? "rising" : "falling");
}

}  // namespace

CycleFile named_cycles(const Job& job) {
    constexpr double digits = 1e-9;  // that another program may print
    CycleFile file = read_cycles(*job.orbits->file, job.model.name, section_coordinates(job));
    const auto own = section_plane(job);
    const auto& theirs = file.head.plane;
    if (!own || !theirs) return file;
    const double size = std::max(std::abs(own->value), std::abs(theirs->value));
    const bool same = own->coordinate == theirs->coordinate && own->direction == theirs->direction &&
                      std::abs(own->value - theirs->value) <= digits * size;
    if (!same)
        throw orbits::DataError(fmt::format("{}: its cycles are points of the section {}, that of the job is {}",
                                            job.orbits->file->string(), description(*theirs), description(*own)));
    return file;
}

bool are_cycles_optional(const Job& job) {
    if (!job.estimate || !job.orbits || job.orbits->file || job.orbits->always || job.orbits->invariants) return false;
    const auto& stages = job.estimate->strategy;
    const auto uses_cycles = [](const StageJob& stage) { return stage.uses(identification::ResidualType::cycles); };
    const bool of_waveforms = job.estimate->waveform && job.estimate->waveform->of_cycles;
    return !of_waveforms && std::any_of(stages.begin(), stages.end(), uses_cycles) &&
           std::all_of(stages.begin(), stages.end(),
                       [&](const StageJob& stage) { return stage.if_needed || !uses_cycles(stage); });
}

CycleFileHead cycle_file_head(const Job& job, Fingerprint fingerprint) {
    CycleFileHead head;
    head.model = job.model.name;
    head.coordinates = section_coordinates(job);
    head.plane = section_plane(job);
    if (job.model.is(models::Kind::forced)) {
        head.phase = job.section_phase;
        head.forcing_period_s = job.model.system->period(job.model.values, models::Clock::time);
    }
    head.own_time = job.model.is(models::Kind::autonomous);
    head.fingerprint = std::move(fingerprint);
    return head;
}

CycleFileHead cycle_file_head(const Job& job, const SearchedSection& section, Fingerprint fingerprint) {
    CycleFileHead head = cycle_file_head(job, std::move(fingerprint));
    head.coordinates = section.coordinates;
    head.plane = section.plane;
    return head;
}

orbits::CycleSearch load_cycles(const Workspace& work, const std::optional<SearchedSection>& section) {
    const OrbitsJob& orbits = *work.job.orbits;
    if (orbits.file) {
        orbits::CycleSearch search = from_file(work);
        say_missing(work, search);
        return search;
    }
    const auto file = work.file("cycles.json");
    const Fingerprint wanted = cycles_fingerprint(work);
    if (std::filesystem::exists(file)) {
        std::string stored;
        orbits::CycleSearch search;
        try {
            CycleFile read = read_cycles(file, work.job.model.name, section->coordinates);
            check_weights(read.search.cycles, work.job);
            stored = read.head.fingerprint.sha256.empty() ? std::string() : to_text(read.head.fingerprint);
            search = std::move(read.search);
        } catch (const orbits::DataError&) {
            // A file of ours that cannot be read is stale, and replaced.
        }
        if (reusable(work, Stage::orbits, file, stored, wanted)) {
            work.progress.reused("orbits", fmt::format("{} cycles from cycles.json", search.cycles.size()));
            say_missing(work, search);
            return search;
        }
    }
    work.progress.begin("orbits");
    if (!section->remark.empty()) work.progress.say(section->remark);
    orbits::CycleSearch search;
    try {
        const RunStop::AtOnce leaving(work.stop);
        orbits::CycleSearchOptions options = section->options;
        options.interrupted = work.asking();
        options.progress = [&work](const std::string& part, std::size_t done, std::size_t total) {
            work.progress.at(static_cast<double>(done), fmt::format("part {} of {}: {}", done + 1, total, part));
        };
        search = section->stream ? orbits::find_cycles(*section->stream, options, section->memory)
                                 : orbits::find_cycles(section->series(), options);
    } catch (const orbits::DataError& error) {
        // The job was checked: what is refused here is the series (too short, a coordinate without spread).
        std::string_view reason = error.what();
        constexpr std::string_view caller = "find_cycles: ";
        if (reason.starts_with(caller)) reason.remove_prefix(caller.size());
        throw orbits::DataError(fmt::format("{}: cannot be searched for cycles: {}. {}",
                                            work.job.data[orbits.data].name, reason,
                                            fmt::join(without_cycles(work.job, *section), " ")));
    }
    if (search.cycles.empty() && !section->stream)
        for (std::string& line : without_cycles(work.job, *section))
            search.remarks.push_back(std::move(line));
    search.remarks.insert(search.remarks.begin(), section->choices.begin(), section->choices.end());
    work.folder.store("cycles.json", cycles_text({cycle_file_head(work.job, *section, wanted), search}));
    work.progress.end(fmt::format("{} cycles from {} candidates", search.cycles.size(), search.candidates));
    say_missing(work, search);
    for (const std::string& remark : search.remarks)
        if (!remark.starts_with("no cycle of period ")) work.progress.say(remark);
    return search;
}

orbits::Invariants compute_invariants(const Workspace& work, const SearchedSection& section,
                                      const orbits::CycleSearch& search) {
    work.progress.begin("invariants");
    orbits::InvariantOptions options;
    options.expansion = work.job.orbits->expansion;
    options.lyapunov.symmetry_signs = section.options.symmetry_signs;
    options.lyapunov.interrupted = options.correlation.interrupted = work.asking();
    try {
        const auto find = [&] {
            const RunStop::AtOnce leaving(work.stop);
            return find_invariants(section.series(), search, options);
        };
        const orbits::Invariants invariants = find();
        work.folder.store("invariants.json", invariants_text(invariants));
        work.progress.end("exponents, dimensions and entropies");
        return invariants;
    } catch (const orbits::DataError& error) {
        throw orbits::DataError(fmt::format("{}: has no invariants to be told: {}",
                                            work.job.data[work.job.orbits->data].name, error.what()));
    }
}

}  // namespace orbid::apps
