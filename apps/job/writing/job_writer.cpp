#include "apps/job/writing/job_writer.hpp"

#include "apps/documents/json_text.hpp"

namespace orbid::apps {

namespace detail {

using Json = nlohmann::ordered_json;

std::string path_text(const std::filesystem::path& path, const std::filesystem::path& folder) {
    const auto relative = path.lexically_relative(std::filesystem::absolute(folder).lexically_normal());
    // Empty when the two have no common root.
    return relative.empty() ? path.generic_string() : relative.generic_string();
}

std::string parameter_name(const Job& job, Eigen::Index index) {
    return std::string(job.model.parameter(index).name);
}

std::string coordinate_name(const Job& job, Eigen::Index index) {
    return std::string(job.model.coordinate(index).name);
}

Json parameter_list(const Job& job, const std::vector<Eigen::Index>& indices) {
    return json_list(indices, [&](Eigen::Index index) { return parameter_name(job, index); });
}

Json coordinate_list(const Job& job, const std::vector<Eigen::Index>& indices) {
    return json_list(indices, [&](Eigen::Index index) { return coordinate_name(job, index); });
}

Json columns_document(const Eigen::MatrixXd& matrix) {
    return json_rows(matrix.transpose());
}

}  // namespace detail

namespace {

using Json = nlohmann::ordered_json;

Json model_document(const Job& job) {
    if (job.model.equations) return detail::equations_document(job);
    Json model{{"name", job.model.name}, {"variant", job.model.variant}};
    if (job.model.size) model["size"] = *job.model.size;
    model["parameters"] = Json::object();
    for (Eigen::Index i = 0; i < job.model.values.size(); ++i)
        model["parameters"][detail::parameter_name(job, i)] = job.model.values[i];
    return model;
}

Json partition_document(const orbits::Partition& partition, const Job& job) {
    return {{"coordinate", job.model.coordinate(partition.coordinate).name},
            {"boundaries", partition.boundaries},
            {"symbols", partition.symbols}};
}

Json reading_error_document(const OrbitsJob& orbits, const Job& job) {
    if (orbits.reading_sd.size() == 0) return "estimate";
    Json sds = Json::object();
    for (Eigen::Index i = 0; i < orbits.reading_sd.size(); ++i) {
        if (job.section_plane && i == job.section_plane->coordinate) continue;
        sds[detail::coordinate_name(job, i)] = orbits.reading_sd[i];
    }
    return sds;
}

Json orbits_document(const Job& job, const std::filesystem::path& folder) {
    const OrbitsJob& orbits = *job.orbits;
    Json object = Json::object();
    if (orbits.file) {
        object["file"] = detail::path_text(*orbits.file, folder);
        if (!orbits.sha256.empty()) object["sha256"] = orbits.sha256;
        return object;
    }
    object["method"] = detail::name_of(orbits.search.method, cycle_method_names);
    object["periods"] = orbits.search.periods;
    object["box"] = orbits.search.box;
    if (orbits.search.neighbours > 0) object["neighbours"] = orbits.search.neighbours;
    object["local_map"] = detail::name_of(orbits.search.order, local_map_names);
    object["minimum_recurrences"] = orbits.search.minimum_recurrences;
    object["symmetry"] = orbits.search.symmetry_signs.has_value();
    object["reading_error"] = reading_error_document(orbits, job);
    if (orbits.search.partition) object["partition"] = partition_document(*orbits.search.partition, job);
    object["invariants"] = orbits.invariants;
    if (orbits.expansion.complete_to > 0)
        object["invariants"] = {{"complete_to", orbits.expansion.complete_to},
                                {"continuous", orbits.expansion.continuous}};
    return object;
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
        document["section"] = {{"coordinate", detail::coordinate_name(job, job.section_plane->coordinate)},
                               {"value", job.section_plane->value},
                               {"direction", job.section_plane->direction}};
    // The default is not written: fingerprints and bytes of stored runs are older than this key.
    if (job.stepper != FlowStepper::verner)
        document["flow"]["stepper"] = detail::name_of(job.stepper, flow_stepper_names);
    for (const DataJob& data : job.data)
        document["data"].push_back(detail::data_document(job, data, folder));
    if (job.orbits) document["orbits"] = orbits_document(job, folder);
    if (job.periodic) document["periodic"] = detail::periodic_document(job);
    if (job.estimate) document["estimate"] = detail::estimate_document(job);
    for (const ReferenceJob& entry : job.reference)
        document["reference"][entry.name] = entry.value;
    document["output"]["series"] = detail::name_of(job.series_output, series_output_names);
    return document;
}

std::string job_text(const Job& job, const std::filesystem::path& folder, const Versions& versions) {
    return json_text(job_document(job, folder, versions));
}

}  // namespace orbid::apps
