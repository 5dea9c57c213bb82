#pragma once

#include <map>
#include <vector>

#include "apps/job/blocks/field_table.hpp"
#include "models/catalogue/registry.hpp"
#include "models/equations/equation_text.hpp"

namespace orbid::apps::describe {

/// The block "model" on its way from or to JSON.
struct ModelBlock {
    ModelJob model;
    models::EquationText text;                                             ///< of a model written in the job
    std::map<models::EquationProblem::Part, std::vector<ValueReader>> at;  ///< where its problems are shown
};

[[nodiscard]] const FieldTable<ModelBlock>& model_fields();
/// A model of the registry; null when there is none of this name.
[[nodiscard]] const models::ModelEntry* registered(const std::string& name);
/// The keys of a model written in the job, "equations" first; the others belong to it.
[[nodiscard]] FieldTable<ModelBlock> equations_fields();
/// Name and parameters of a model written in the job; each may be absent.
void read_equation_names(const std::optional<ValueReader>& name, const std::optional<ValueReader>& parameters,
                         ModelBlock& block);
/// Puts the model that the job writes into `job`. Problems of the whole are reported at `equations`.
void use_equations(const ValueReader& equations, const ModelBlock& block, Job& job);
/// The number alone, where that says everything.
[[nodiscard]] nlohmann::ordered_json equation_parameter_document(models::EquationText::Parameter parameter,
                                                                 double value);

/// Left out where the model has no section.
[[nodiscard]] nlohmann::ordered_json section_document(const Job& job);
/// How flows are computed.
[[nodiscard]] const FieldTable<Job>& flow_fields();
/// What is stored.
[[nodiscard]] const FieldTable<Job>& output_fields();

}  // namespace orbid::apps::describe
