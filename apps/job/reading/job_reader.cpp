#include "apps/job/reading/job_reader.hpp"

#include <algorithm>
#include <stdexcept>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/schema_check.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/blocks/model_block.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/flow_stepper.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

/// "flow", after all that moves parameters; model.system becomes one with that stepper.
void read_flow(ObjectReader& root, Job& job) {
    const auto value = root.find("flow");
    if (!value) return;
    read_object(*value, describe::flow_fields(), job, job);
    // What the stepper can do is asked of a model at values that are allowed.
    if (job.stepper != FlowStepper::odeint || !job.model.system || value->problem_count() > 0) return;
    const std::string why = odeint_refusal(job);
    if (why.empty())
        job.model.system = with_stepper(job.model.system, job.stepper);
    else
        ObjectReader(*value).find("stepper")->report(fmt::format("must be \"verner\" here: {}", why));
}

void read_reference(ObjectReader& root, Job& job) {
    const auto value = root.find("reference");
    if (!value) return;
    std::vector<std::string> known = parameter_names(job);
    if (job.estimate) {
        for (const DerivedJob& derived : job.estimate->derived)
            known.push_back(derived.name);
    }
    for (const DataJob& data : job.data) {
        for (const Eigen::Index parameter : data.free)
            known.push_back(parameter_names(job)[static_cast<std::size_t>(parameter)] + "@" + data.name);
    }
    for (const auto& [name, member] : value->members()) {
        const auto number = member.number();
        if (job.model.system && std::find(known.begin(), known.end(), name) == known.end()) {
            member.report(fmt::format("\"{}\" is neither a parameter of the model nor a derived quantity{}", name,
                                      suggestion(name, known)));
        } else if (number) {
            job.reference.push_back({name, *number});
        }
    }
}

/// Keys that job.json carries beside the job: what wrote it, nothing that a run depends on.
void read_origin(ObjectReader& root) {
    (void)root.find("$schema");
    if (const auto format = root.find("format")) (void)format->choice({"orbid-job/1"});
    if (const auto versions = root.find("versions")) {
        for (const auto& [name, value] : versions->members())
            (void)value.text();
    }
}

void read_root(const ValueReader& value, Job& job) {
    ObjectReader root(value);
    read_origin(root);
    root.read("title", job.title);
    read_model(root, job);
    root.read("seed", job.seed);
    read_section(root, job);
    read_data(root, job);
    read_orbits(root, job);
    read_periodic(root, job);
    read_estimate(root, job);
    read_reference(root, job);
    read_flow(root, job);
    if (const auto output = root.find("output")) read_object(*output, describe::output_fields(), job, job);
    root.finish();
    const bool simulates =
        std::any_of(job.data.begin(), job.data.end(), [](const DataJob& data) { return data.simulation.has_value(); });
    const bool named = root.find("orbits") || root.find("periodic") || root.find("estimate");
    if (value.sound() && !named && !simulates)
        root.self().report(
            "names nothing to do: add \"data\" with \"simulate\", \"orbits\", \"periodic\" or \"estimate\"");
}

JobReading read_job_with(std::string_view text, const std::filesystem::path& source,
                         void (*read)(const ValueReader& value, Job& job)) {
    JsonDocument document = parse_json(text);
    JobReading reading;
    reading.problems = std::move(document.problems);
    Job job;
    job.source = std::filesystem::absolute(source).lexically_normal();
    if (document.root) {
        check_described(*document.root, job_description(), reading.problems);
        read(ValueReader(*document.root, "", reading.problems, &job_description()), job);
    }
    std::stable_sort(reading.problems.begin(), reading.problems.end(), [](const Problem& a, const Problem& b) {
        return a.place.line != b.place.line ? a.place.line < b.place.line : a.place.column < b.place.column;
    });
    if (reading.problems.empty()) reading.job = std::move(job);
    return reading;
}

}  // namespace

int JobReading::exit_code() const {
    if (problems.empty()) return 0;
    const bool only_data =
        std::all_of(problems.begin(), problems.end(), [](const Problem& p) { return p.kind == Problem::Kind::data; });
    return only_data ? 3 : 2;
}

JobReading read_job(std::string_view text, const std::filesystem::path& source) {
    return read_job_with(text, source, read_root);
}

JobReading read_job_model(std::string_view text, const std::filesystem::path& source) {
    return read_job_with(text, source, [](const ValueReader& value, Job& job) {
        ObjectReader root(value);
        read_model(root, job);
        read_section(root, job);
    });
}

JobReading read_job_file(const std::filesystem::path& file) {
    const auto refuse = [](std::string rule) {
        JobReading reading;
        reading.problems.push_back({{0, 0}, "", std::move(rule), Problem::Kind::job});
        return reading;
    };
    if (!std::filesystem::exists(file)) return refuse("the job file does not exist");
    if (std::filesystem::is_directory(file)) return refuse("is a folder, not a job file");
    std::string text;
    try {
        text = read_whole_file(file, largest_job_file, true);
    } catch (const std::runtime_error& error) {
        return refuse(error.what());
    }
    return read_job(text, file);
}

}  // namespace orbid::apps
