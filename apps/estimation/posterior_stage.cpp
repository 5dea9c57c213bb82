#include "apps/estimation/posterior_stage.hpp"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/estimation/checkpoint_fields.hpp"
#include "estimator/exploration/evidence.hpp"

namespace orbid::apps {

namespace {

/// A copy of every residual, for a run of its own.
std::vector<std::unique_ptr<estimator::Residual>> copies(const JobResiduals& residuals) {
    std::vector<std::unique_ptr<estimator::Residual>> list;
    if (residuals.cycles) list.push_back(std::make_unique<orbits::CycleResidual>(*residuals.cycles));
    for (const auto& series : residuals.series)
        list.push_back(std::make_unique<orbits::SeriesResidual>(*series));
    if (residuals.waveform.residual)
        list.push_back(std::make_unique<periodic::WaveformResidual>(*residuals.waveform.residual));
    return list;
}

/// Names as the estimator knows them; empty = all.
std::vector<std::string> chosen(const ParameterChoice& choice,
                                const std::vector<estimator::FreeParameter>& parameters) {
    std::vector<std::string> names;
    if (choice.all) return names;
    for (const auto& parameter : parameters)
        if (choice.contains(parameter.name)) names.push_back(parameter.name);
    // What is no parameter belongs to an error group; the reader checked it.
    for (const std::string& name : choice.names) {
        const auto is_it = [&](const estimator::FreeParameter& parameter) {
            return parameter.name == name || parameter.name.starts_with(name + ".");
        };
        if (std::none_of(parameters.begin(), parameters.end(), is_it)) names.push_back(name);
    }
    return names;
}

/// Draws call an error parameter "group:scale", profiles and marginals "group.scale": one name in all files.
void name_as_elsewhere(estimator::PosteriorSample& sample) {
    const auto rename = [](std::string& name) { std::replace(name.begin(), name.end(), ':', '.'); };
    for (auto& error : sample.errors)
        rename(error.name);
    for (auto& name : sample.names)
        rename(name);
}

}  // namespace

void search_starts(const Workspace& work, const JobResiduals& residuals,
                   const std::vector<estimator::DerivedQuantity>& derived, const estimator::EstimateOptions& options,
                   std::vector<estimator::FreeParameter>& parameters, PosteriorResults& results) {
    const MultiStartJob& job = work.job.estimate->multi_start;
    if (job.starts <= 1) return;
    estimator::MultiStartOptions search;
    search.starts = static_cast<int>(job.starts);
    search.seed = job.seed;
    search.estimate = options;
    search.estimate.progress = {};
    search.estimate.verdict = false;
    work.progress.begin("starts", static_cast<double>(job.starts), "starts");
    search.progress = [&](int finished, int) { work.progress.at(finished); };
    const auto found = estimator::multi_start(
        parameters, [&] { return copies(residuals); }, derived, search);
    results.optima = found.optima;
    results.runs = found.runs;
    work.progress.end(fmt::format("{} optima from {} starts", found.optima.size(), found.runs.size()));
    if (found.best_start < 0 || found.best.parameters.size() != parameters.size()) return;
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = found.best.parameters[i].value;
}

void explore_posterior(const Workspace& work, const std::vector<estimator::FreeParameter>& parameters,
                       const std::vector<estimator::Residual*>& residuals,
                       const std::vector<estimator::DerivedQuantity>& derived,
                       const estimator::EstimateOptions& options, const estimator::Estimate& estimate,
                       Checkpoint& checkpoint, PosteriorResults& results) {
    const EstimateJob& job = *work.job.estimate;
    estimator::EstimateOptions quiet = options;
    quiet.progress = {};
    // A wrong call would be our bug, but a posterior without an integral is the job's: it is named, and the run goes
    // on.
    const auto attempt = [&](std::string_view block, const auto& action) {
        if (work.interruption.asked()) return;
        const bool useful = estimate.status == estimator::EstimateStatus::converged ||
                            estimate.status == estimator::EstimateStatus::singular;
        if (!useful) {
            results.refused.emplace_back(
                block, fmt::format("the estimate has not converged ({})", estimator::name(estimate.status)));
            return;
        }
        try {
            action();
        } catch (const std::invalid_argument& error) {
            results.refused.emplace_back(block, error.what());
            work.progress.end(error.what());
        }
    };
    // What a run before this one has finished is taken from it. Kept before it is told.
    const auto keep = [&](const std::string& name, auto& found) {
        if (!work.interruption.asked()) checkpoint.keep(name, found);
    };
    if (job.profile.any()) {
        attempt("profile", [&] {
            if (checkpoint.recall("profile", results.profiles)) {
                work.progress.reused("profile", fmt::format("{} unknowns", results.profiles.size()));
                return;
            }
            work.progress.begin("profile");
            estimator::ProfileOptions profile;
            profile.names = chosen(job.profile, parameters);
            results.profiles = estimator::profiles(parameters, residuals, quiet, estimate, profile);
            keep("profile", results.profiles);
            work.progress.end(fmt::format("{} unknowns", results.profiles.size()));
        });
    }
    if (job.marginals.any()) {
        attempt("marginals", [&] {
            if (checkpoint.recall("marginals", results.marginals)) {
                work.progress.reused("marginals", fmt::format("{} unknowns", results.marginals.size()));
                return;
            }
            work.progress.begin("marginals");
            estimator::MarginalOptions marginal;
            marginal.names = chosen(job.marginals, parameters);
            results.marginals = estimator::marginals(parameters, residuals, quiet, estimate, marginal);
            keep("marginals", results.marginals);
            work.progress.end(fmt::format("{} unknowns", results.marginals.size()));
        });
    }
    if (job.sample.draws > 0) {
        attempt("posterior", [&] {
            if (checkpoint.recall("posterior", results.sample)) {
                work.folder.store("posterior.csv", draws_text(*results.sample));
                work.progress.reused("posterior", fmt::format("{} chains", results.sample->chains.size()));
                return;
            }
            estimator::SampleOptions sample;
            sample.draws = static_cast<int>(job.sample.draws);
            sample.chains = static_cast<int>(job.sample.chains);
            sample.warm_up = static_cast<int>(job.sample.warm_up);
            sample.seed = work.job.seed;
            sample.interrupted = [&] { return work.interruption.asked(); };
            sample.progress = [&](int done, int) { work.progress.at(done); };
            const std::size_t iterations = job.sample.chains * (job.sample.draws + job.sample.warm_up);
            work.progress.begin("posterior", static_cast<double>(iterations), "iterations");
            results.sample = estimator::sample_posterior(parameters, residuals, derived, quiet, estimate, sample);
            name_as_elsewhere(*results.sample);
            work.folder.store("posterior.csv", draws_text(*results.sample));
            keep("posterior", results.sample);
            work.progress.end(fmt::format("{} chains: {}{}", results.sample->chains.size(),
                                          name(results.sample->status),
                                          results.sample->trusted ? "" : ", not trusted"));
        });
    }
}

LogEvidence evidence_of(const Job& job, const std::vector<estimator::FreeParameter>& parameters,
                        const std::vector<estimator::Residual*>& residuals, const estimator::EstimateOptions& options,
                        const estimator::Estimate& estimate) {
    const auto terms = estimator::evidence_terms(parameters, residuals, options, estimate);
    const estimator::Evidence evidence = estimator::log_evidence(terms);
    if (!evidence.known) return {std::nullopt, evidence.message};
    // The estimator counts latent states as flat; a normal prior of an initial value is a record of its own.
    const auto& series = job.estimate->series;
    for (const std::size_t index : series ? series->data : std::vector<std::size_t>{}) {
        const DataJob& data = job.data[index];
        for (std::size_t i = 0; i < data.initial_state.size(); ++i) {
            const InitialValueJob& initial = data.initial_state[i];
            if (!initial.estimate || initial.is_parameter() || estimator::is_proper(initial.prior)) continue;
            return {std::nullopt, fmt::format("the initial {} of {} has no proper prior",
                                              job.model.system->coordinates()[i].name, data.name)};
        }
    }
    if (job.estimate->waveform) {
        for (const auto& experiment : job.estimate->waveform->experiments)
            if (experiment.phase.estimate ||
                std::any_of(experiment.offsets.begin(), experiment.offsets.end(),
                            [](const periodic::WaveformUnknown& offset) { return offset.estimate; }))
                return {std::nullopt, "phases and offsets of waveforms have no proper prior"};
    }
    return {evidence.value, {}};
}

}  // namespace orbid::apps
