#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;

/// The inverse-Wishart prior of a covariance whose coordinates are known.
const FieldTable<CovarianceJob>& wishart_fields() {
    static const FieldTable<CovarianceJob> table{
        {key("dof", above(0.0), "Degrees of freedom: above the number of responses less one.").required_always(),
         [](const ValueReader& value, const Job&, CovarianceJob& covariance) {
             const double least = static_cast<double>(covariance.coordinates.size()) - 1.0;
             covariance.dof =
                 value.number([&](double x) { return x > least; }, fmt::format("> {}", least)).value_or(0.0);
         },
         [](const CovarianceJob& covariance, const Writing&) -> Json { return covariance.dof; }},
        {key("matrix", matrix(), "One row per response; symmetric and positive definite.").required_always(),
         [](const ValueReader& value, const Job&, CovarianceJob& covariance) {
             const auto size = static_cast<Eigen::Index>(covariance.coordinates.size());
             covariance.psi = read_matrix(value, size).value_or(Eigen::MatrixXd::Identity(size, size));
             const Eigen::MatrixXd& psi = covariance.psi;
             if (psi != psi.transpose() || !models::CholeskyFactor(psi).positive_definite())
                 value.report("must be symmetric and positive definite");
         },
         [](const CovarianceJob& covariance, const Writing&) { return json_rows(covariance.psi); }}};
    return table;
}

const FieldTable<CovarianceJob>& covariance_prior_fields() {
    static const FieldTable<CovarianceJob> table{
        object_field<CovarianceJob>(key("inverse_wishart", {}, "The density of a covariance.").required_always(),
                                    wishart_fields(), std::identity{})};
    return table;
}

}  // namespace

const FieldTable<CovarianceJob>& covariance_fields() {
    static const FieldTable<CovarianceJob> table{
        {key("of", names(2), "The coordinates, two or more.").required_always(),
         [](const ValueReader& value, const Job& job, CovarianceJob& covariance) {
             for (const auto& [name, item] : read_names(value))
                 if (const auto index = coordinate_named(name, item, job)) covariance.coordinates.push_back(*index);
         },
         [](const CovarianceJob& covariance, const Writing& at) {
             return coordinate_list(at.job, covariance.coordinates);
         }},
        object_field<CovarianceJob>(key("prior", {}, "What is known of the covariance."), covariance_prior_fields(),
                                    std::identity{})
            .written_if([](const CovarianceJob& covariance) { return covariance.dof > 0.0; })};
    return table;
}

KeySchema covariance_key() {
    return key("covariance", named("covariance", names(2) | object(keys_of(covariance_fields()))),
               "Coordinates whose errors have one full covariance.");
}

Json covariance_document(const std::vector<CovarianceJob>& covariances, const Writing& at) {
    return covariances.empty() ? left_out() : fields_document(covariances.front(), covariance_fields(), at);
}

}  // namespace orbid::apps::describe
