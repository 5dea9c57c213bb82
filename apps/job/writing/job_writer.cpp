#include "apps/job/writing/job_writer.hpp"

#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/model_block.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"

namespace orbid::apps {

using Json = nlohmann::ordered_json;

Json job_document(const Job& job, const std::filesystem::path& folder, const Versions& versions) {
    Json document{{"format", "orbid-job/1"}};
    for (const auto& [name, version] : versions)
        document["versions"][name] = version;
    document["title"] = job.title;
    describe::ModelBlock model;
    model.model = job.model;
    if (job.model.equations) model.text = job.model.equations->text();
    document["model"] = fields_document(model, describe::model_fields(), {job});
    document["seed"] = job.seed;
    if (auto section = describe::section_document(job); !section.is_discarded())
        document["section"] = std::move(section);
    // The default is not written: fingerprints and bytes of stored runs are older than this key.
    if (job.stepper != FlowStepper::verner) document["flow"] = fields_document(job, describe::flow_fields());
    for (const DataJob& data : job.data)
        document["data"].push_back(fields_document(data, describe::data_fields(), {job, folder}));
    if (job.orbits) document["orbits"] = fields_document(*job.orbits, describe::orbits_fields(), {job, folder});
    if (job.periodic) document["periodic"] = fields_document(*job.periodic, describe::periodic_fields(), {job, folder});
    if (job.estimate) document["estimate"] = fields_document(*job.estimate, describe::estimate_fields(), {job, folder});
    for (const ReferenceJob& entry : job.reference)
        document["reference"][entry.name] = entry.value;
    document["output"] = fields_document(job, describe::output_fields());
    return document;
}

std::string job_text(const Job& job, const std::filesystem::path& folder, const Versions& versions) {
    return json_text(job_document(job, folder, versions));
}

}  // namespace orbid::apps
