#include "apps/job/writing/job_writer.hpp"

#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

Json model_document(const Job& job) {
    if (job.model.equations) return detail::equations_document(job);
    Json model{{"name", job.model.name}, {"variant", job.model.variant}};
    if (job.model.size) model["size"] = *job.model.size;
    model["parameters"] = Json::object();
    for (Eigen::Index i = 0; i < job.model.values.size(); ++i)
        model["parameters"][parameter_name(job, i)] = job.model.values[i];
    return model;
}

}  // namespace

Json job_document(const Job& job, const std::filesystem::path& folder, const Versions& versions) {
    Json document{{"format", "orbid-job/1"}};
    for (const auto& [name, version] : versions)
        document["versions"][name] = version;
    document["title"] = job.title;
    document["model"] = model_document(job);
    document["seed"] = job.seed;
    if (job.model.is(models::Kind::forced)) document["section"]["phase"] = job.section_phase;
    if (job.section_plane)
        document["section"] = {{"coordinate", coordinate_name(job, job.section_plane->coordinate)},
                               {"value", job.section_plane->value},
                               {"direction", job.section_plane->direction}};
    // The default is not written: fingerprints and bytes of stored runs are older than this key.
    if (job.stepper != FlowStepper::verner) document["flow"]["stepper"] = name_of(job.stepper, flow_stepper_names);
    for (const DataJob& data : job.data)
        document["data"].push_back(detail::data_document(job, data, folder));
    if (job.orbits) document["orbits"] = fields_document(*job.orbits, describe::orbits_fields(), {job, folder});
    if (job.periodic) document["periodic"] = fields_document(*job.periodic, describe::periodic_fields(), {job, folder});
    if (job.estimate) document["estimate"] = detail::estimate_document(job);
    for (const ReferenceJob& entry : job.reference)
        document["reference"][entry.name] = entry.value;
    document["output"]["series"] = name_of(job.series_output, series_output_names);
    return document;
}

std::string job_text(const Job& job, const std::filesystem::path& folder, const Versions& versions) {
    return json_text(job_document(job, folder, versions));
}

}  // namespace orbid::apps
