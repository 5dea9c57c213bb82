#include "apps/stages/data_stage.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include <fmt/format.h>

#include "apps/documents/json_value.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/results/counted_noun.hpp"
#include "apps/stages/periodic_stage.hpp"
#include "apps/stages/recorded_series.hpp"
#include "models/arithmetic/splitmix64.hpp"
#include "orbits/records/series_file.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

namespace orbid::apps {

namespace {

using Kind = orbits::TrajectoryEvent::Kind;

/// Random numbers of an experiment: experiments of one job must not repeat each other's errors.
std::uint64_t experiment_seed(const Job& job, std::size_t index) {
    return index == 0 ? job.seed : models::splitmix64(job.seed ^ models::splitmix64(index));
}

orbits::VirtualExperimentOptions simulation_options(const Job& job, std::size_t index) {
    const DataJob& data = job.data[index];
    const SimulationJob& simulation = *data.simulation;
    orbits::VirtualExperimentOptions options;
    if (simulation.sampling == orbits::Series::Sampling::section) {
        orbits::SectionPlan plan;
        plan.sections = simulation.sections;
        plan.transient = simulation.transient;
        plan.section = job_section(job);
        options.plan = plan;
    } else {
        options.plan = orbits::SamplePlan{simulation.step, simulation.count, simulation.transient};
    }
    options.trajectories = simulation.trajectories;
    if (!simulation.initial.empty()) {
        options.initial.resize(job.model.system->dimension(), static_cast<Eigen::Index>(simulation.initial.size()));
        for (std::size_t i = 0; i < simulation.initial.size(); ++i)
            options.initial.col(static_cast<Eigen::Index>(i)) = simulation.initial[i];
    }
    options.restart = simulation.restart ? orbits::Restart::when_captured_or_at_rest : orbits::Restart::never;
    options.phase = job.section_phase;
    options.sensor = data.sensor;
    options.noise = simulation.noise;
    options.noise_correlation = simulation.noise_correlation;
    options.seed = experiment_seed(job, index);
    return options;
}

std::string words(const orbits::TrajectoryEvent& event) {
    switch (event.kind) {
        case Kind::captured:
            return fmt::format("captured by a stable orbit of period {}", event.period);
        case Kind::failed:
            return fmt::format("cannot be continued: {}", models::description(event.status));
        default:
            return std::string(orbits::name(event.kind));
    }
}

std::vector<Capture> captures(const std::string& experiment, const std::vector<orbits::TrajectoryEvent>& events) {
    std::vector<Capture> list;
    for (const auto& event : events) {
        if (event.kind == Kind::restarted) continue;
        list.push_back({experiment, static_cast<int>(event.trajectory), event.section, words(event)});
    }
    return list;
}

/// What series files say of their origin: the fingerprint, and what the simulation noticed.
std::string origin_text(const Fingerprint& fingerprint, const std::vector<Capture>& captured) {
    nlohmann::json list = nlohmann::json::array();
    for (const Capture& capture : captured)
        list.push_back({{"experiment", capture.experiment},
                        {"trajectory", capture.trajectory},
                        {"section", capture.section},
                        {"what", capture.what}});
    return nlohmann::json{{"fingerprint", to_text(fingerprint)}, {"captured", list}}.dump();
}

struct Origin {
    std::string fingerprint;
    std::vector<Capture> captured;
};

/// A text that is no origin of ours gives an empty one: the file then counts as stale.
Origin origin_of(const std::string& text) {
    Origin origin;
    const auto json = json_value_or_discarded(text);
    if (!json.is_object() || !json.contains("fingerprint") || !json["fingerprint"].is_string()) return origin;
    origin.fingerprint = json["fingerprint"].get<std::string>();
    if (!json.contains("captured") || !json["captured"].is_array()) return origin;
    for (const auto& entry : json["captured"]) {
        if (!entry.is_object()) continue;
        try {
            origin.captured.push_back(
                {entry.at("experiment").get<std::string>(), whole_number<int>(entry.at("trajectory")),
                 whole_number<std::size_t>(entry.at("section")), entry.at("what").get<std::string>()});
        } catch (const nlohmann::json::exception&) {
            return {};
        }
    }
    return origin;
}

orbits::Series read_stored(const std::filesystem::path& file, SeriesOutput format, const orbits::Series& shape,
                           bool timed, const std::function<bool()>& interrupted) {
    if (format != SeriesOutput::csv) return orbits::read_hdf5(file, 1, interrupted);
    orbits::TableLayout layout = orbits::table_layout(shape);
    if (timed) layout.time = std::string("t");
    layout.interrupted = interrupted;
    return orbits::read_csv(file, layout);
}

/// A series without data: what the coordinates of a simulated series are called.
orbits::Series empty_series(const Job& job, const DataJob& data) {
    orbits::Series series;
    series.sampling = data.sampling();
    series.phase = job.section_phase;
    for (std::size_t i = 0; i < job.model.system->coordinates().size(); ++i)
        series.coordinates.push_back(read_coordinate(job, data, i));
    return series;
}

/// series.h5 or .csv, series_NAME.h5 with several experiments.
std::string series_file_name(const Job& job, std::size_t index) {
    const std::string ending = job.series_output == SeriesOutput::csv ? ".csv" : ".h5";
    return job.data.size() == 1 ? "series" + ending : fmt::format("series_{}{}", job.data[index].name, ending);
}

Experiment simulated(const Workspace& work, std::size_t index) {
    const Job& job = work.job;
    const DataJob& data = job.data[index];
    const bool stored = job.series_output != SeriesOutput::none;
    const auto file = work.file(series_file_name(job, index));
    const std::string place = work.document["data"].is_array() ? fmt::format("/data/{}", index) : "/data";
    const Fingerprint wanted = stage_fingerprint(
        work.document, {"/model", "/seed", "/section", "/flow", place + "/simulate", place + "/inputs",
                        place + "/interpolation", place + "/delay", place + "/sensor", place + "/parameters"});

    const LabelledInputs inputs = load_inputs(job, data);
    if (stored && std::filesystem::exists(file)) {
        // An unreadable file of ours is one to be replaced, unless a later stage alone was asked for.
        std::optional<Origin> origin;
        try {
            origin = origin_of(orbits::read_origin(file));
        } catch (const orbits::DataError&) {
            origin = Origin{};
        }
        if (reusable(work, Stage::simulate, file, origin->fingerprint, wanted)) {
            const RunStop::AtOnce leaving(work.stop);
            Experiment experiment{read_stored(file, job.series_output, empty_series(job, data),
                                              job.section_plane.has_value(), work.asking()),
                                  origin->captured,
                                  {}};
            experiment.inputs = by_segment(inputs, experiment.series.segments);
            work.progress.reused("simulate", fmt::format("{} from {}", counted(experiment.series.size(), "point"),
                                                         file.filename().string()));
            return experiment;
        }
    }

    work.progress.begin("simulate");
    const auto run_experiment = [&] {
        const RunStop::AtOnce leaving(work.stop);
        auto options = simulation_options(job, index);
        options.interrupted = work.asking();
        const Eigen::VectorXd values = data.with_own(job.model.values);
        const auto delay = data.inputs ? data.inputs->delay_parameter : std::nullopt;
        const auto system = system_with(job, delay ? load_inputs(job, data, values[*delay]) : inputs);
        return orbits::simulate(*system, values, options);
    };
    auto run = run_experiment();
    if (!run.complete) throw orbits::DataError(fmt::format("{}: cannot be simulated: {}", data.name, run.message));
    Experiment experiment{std::move(run.series), captures(data.name, run.events), {}};
    experiment.inputs = by_segment(inputs, experiment.series.segments);
    experiment.series.origin = origin_text(wanted, experiment.captured);
    if (stored) {
        // A simulation that is not stored is repeated: nothing is lost.
        const RunStop::AtOnce leaving(work.stop);
        const auto write = job.series_output == SeriesOutput::csv ? orbits::write_csv : orbits::write_hdf5;
        work.folder.store(
            file.filename().string(),
            [&](const std::filesystem::path& temporary) { write(temporary, experiment.series, work.asking()); },
            work.asking());
    }
    work.progress.end(fmt::format("{} in {}", counted(experiment.series.size(), "point"),
                                  counted(experiment.series.segments.size(), "segment")));
    for (const Capture& capture : experiment.captured)
        work.progress.say(fmt::format("{}, trajectory {}, section {}: {}", capture.experiment, capture.trajectory,
                                      capture.section, capture.what));
    return experiment;
}

Experiment measured(const Workspace& work, std::size_t index) {
    const DataJob& data = work.job.data[index];
    work.progress.begin("read");
    const RunStop::AtOnce leaving(work.stop);
    Experiment experiment;
    if (data.streamed()) {
        experiment.stream = recorded_stream(work.job, index, work.asking());
        experiment.series = experiment.stream->header();
    } else {
        experiment.series = recorded_series(work.job, index, work.asking());
    }
    experiment.inputs = by_segment(load_inputs(work.job, data), experiment.series.segments);
    work.progress.end(fmt::format("{} in {} from {}{}", counted(experiment.points(), "point"),
                                  counted(experiment.segments(), "segment"), data.streamed() ? "the stream " : "",
                                  std::filesystem::path(data.file->shown()).filename().string()));
    return experiment;
}

/// Sums of squares must neither overflow nor vanish.
void refuse_beyond_squares(const orbits::Series& series, const std::string& name) {
    constexpr double most = 1e100;
    for (Eigen::Index i = 0; i < series.dimension(); ++i) {
        double largest = 0.0;
        for (const orbits::Segment& segment : series.segments)
            for (const double value : segment.values.row(i))
                if (std::isfinite(value)) largest = std::max(largest, std::abs(value));
        if (largest == 0.0 || (largest <= most && largest >= 1.0 / most)) continue;
        throw orbits::DataError(fmt::format(
            "{}: the largest reading of {} is {:.3g}, whose square a computer's number does not hold; use a unit in "
            "which it lies between 1e-100 and 1e100",
            name, series.coordinate(i).name, largest));
    }
}

}  // namespace

std::optional<orbits::Series> simulated_series(const Job& job, std::size_t index, const std::filesystem::path& folder,
                                               const std::function<bool()>& interrupted) {
    const auto file = folder / series_file_name(job, index);
    if (job.series_output == SeriesOutput::none || !std::filesystem::exists(file)) return std::nullopt;
    return read_stored(file, job.series_output, empty_series(job, job.data[index]), job.section_plane.has_value(),
                       interrupted);
}

std::vector<Experiment> load_data(const Workspace& work) {
    std::vector<Experiment> experiments;
    for (std::size_t i = 0; i < work.job.data.size(); ++i) {
        experiments.push_back(work.job.data[i].simulation ? simulated(work, i) : measured(work, i));
        refuse_beyond_squares(experiments.back().series, work.job.data[i].name);
    }
    return experiments;
}

}  // namespace orbid::apps
