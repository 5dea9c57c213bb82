#include "apps/estimation/posterior_stage.hpp"

#include <algorithm>
#include <optional>
#include <string>

#include <fmt/format.h>

#include "apps/estimation/checkpoint_fields.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "estimator/exploration/evidence.hpp"
#include "estimator/problem/tie.hpp"
#include "models/definition/wrong_data.hpp"

namespace orbid::apps {

namespace {

/// Names as the estimator knows them; empty = all.
std::vector<std::string> chosen(const ParameterChoice& choice,
                                const std::vector<estimator::FreeParameter>& parameters) {
    std::vector<std::string> names;
    if (choice.all) return names;
    for (const auto& parameter : parameters)
        if (choice.contains(parameter.name) && !estimator::is_held(parameter)) names.push_back(parameter.name);
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

/// The parts of an exploration, each recalled from the checkpoint or computed and kept. An interruption keeps finished
/// parts.
class Exploration {
public:
    Exploration(const Workspace& work, const estimator::Estimate& estimate, Checkpoint& checkpoint,
                PosteriorResults& results)
        : work_(work), estimate_(estimate), checkpoint_(checkpoint), results_(results) {}

    /// What is found of single unknowns.
    /// @param asked  names of them; empty: all
    template <class Found, class Compute>
    void unknowns(const std::string& block, const std::vector<std::string>& asked, std::vector<Found>& found,
                  const Compute& compute) {
        attempt(block, [&] {
            const auto count = [&] { return fmt::format("{} unknowns", found.size()); };
            if (checkpoint_.recall(block, found)) return work_.progress.reused(block, count());
            const std::size_t total = asked.empty() ? all_unknowns() : asked.size();
            work_.progress.begin(block, static_cast<double>(total), "unknowns");
            found = compute();
            keep(block, found);
            work_.progress.end(count());
        });
    }

    /// @param compute  draws with these options.
    template <class Compute>
    void sample(const SampleJob& job, const Compute& compute) {
        attempt("posterior", [&] {
            std::optional<estimator::PosteriorSample>& found = results_.sample;
            if (checkpoint_.recall("posterior", found)) {
                work_.folder.store("posterior.csv", draws_text(*found));
                work_.progress.reused("posterior", fmt::format("{} chains", found->chains.size()));
                return;
            }
            estimator::SampleOptions options;
            options.draws = static_cast<int>(job.draws);
            options.chains = static_cast<int>(job.chains);
            options.warm_up = static_cast<int>(job.warm_up);
            options.seed = work_.job.seed;
            options.interrupted = [this] { return work_.interruption.asked(); };
            options.progress = [this](int done, int total) {
                work_.progress.at(done, done < total ? "" : "diagnostics");
            };
            const std::size_t iterations = job.chains * (job.draws + job.warm_up);
            work_.progress.begin("posterior", static_cast<double>(iterations), "iterations");
            found = compute(options);
            name_as_elsewhere(*found);
            work_.folder.store("posterior.csv", draws_text(*found));
            keep("posterior", found);
            work_.progress.end(fmt::format("{} chains: {}{}", found->chains.size(), name(found->status),
                                           found->trusted ? "" : ", not trusted"));
        });
    }

    /// @param compute  with these options.
    template <class Compute>
    void bootstrap(const IntervalsJob& job, const Compute& compute) {
        attempt("intervals", [&] {
            estimator::BootstrapOptions options;
            options.replicates = job.bootstrap;
            options.draws = {job.kind, work_.job.seed, has_given_links()};
            (void)checkpoint_.recall("intervals", options.done);
            options.keep = [this](std::vector<estimator::BootstrapReplicate> done) {
                checkpoint_.keep("intervals", done);
            };
            options.progress = [this](std::size_t finished, std::size_t) {
                work_.progress.at(static_cast<double>(finished));
            };
            if (!options.done.empty())
                work_.progress.reused("intervals", fmt::format("{} of {} replicates, from checkpoint.bin",
                                                               options.done.size(), job.bootstrap));
            work_.progress.begin("intervals", static_cast<double>(job.bootstrap), "replicates");
            results_.bootstrap = compute(options);
            const estimator::Bootstrap& found = *results_.bootstrap;
            if (found.replicates.size() > options.done.size()) options.keep(found.replicates);
            work_.folder.store("bootstrap.csv", replicates_text(found));
            work_.progress.end(fmt::format("{} replicates, {} failed", found.replicates.size(), found.failed));
        });
    }

private:
    /// Whether the matching of nodes has a sd that the job gives: that of errors which the model has.
    [[nodiscard]] bool has_given_links() const {
        const auto& series = work_.job.estimate->series;
        return series && series->matching.kind == MatchingJob::Kind::given;
    }

    /// Parameters and error parameters that are estimated.
    [[nodiscard]] std::size_t all_unknowns() const {
        std::size_t count = estimate_.parameters.size();
        for (const estimator::EstimatedScale& scale : estimate_.scales)
            if (scale.estimated) count += 1 + scale.shape.size();
        return count;
    }

    /// A wrong call would be our bug, but a posterior without an integral is the job's: it is named, and the run goes
    /// on.
    template <class Action>
    void attempt(const std::string& block, const Action& action) {
        if (work_.interruption.asked()) return;
        const bool useful = estimate_.status == estimator::EstimateStatus::converged ||
                            estimate_.status == estimator::EstimateStatus::singular;
        if (!useful) {
            results_.refused.emplace_back(
                block, fmt::format("the estimate has not converged ({})", estimator::name(estimate_.status)));
            return;
        }
        try {
            action();
        } catch (const models::DataError& error) {
            results_.refused.emplace_back(block, error.what());
            work_.progress.end(error.what());
        }
    }

    /// Before it is told.
    template <class Found>
    void keep(const std::string& block, Found& found) {
        if (!work_.interruption.asked()) checkpoint_.keep(block, found);
    }

    const Workspace& work_;
    const estimator::Estimate& estimate_;
    Checkpoint& checkpoint_;
    PosteriorResults& results_;
};

}  // namespace

void explore_posterior(const Workspace& work, const std::vector<estimator::FreeParameter>& parameters,
                       const std::vector<const estimator::Residual*>& residuals,
                       const std::vector<estimator::DerivedQuantity>& derived,
                       const estimator::EstimateOptions& options, const estimator::Estimate& estimate,
                       Checkpoint& checkpoint, PosteriorResults& results) {
    const EstimateJob& job = *work.job.estimate;
    estimator::EstimateOptions quiet = options;
    quiet.progress = {};
    quiet.watched = {};
    estimator::EstimateOptions tilted = quiet;
    if (estimate.tilt) tilted.joint_priors.push_back(*estimate.tilt);
    const auto progress = [&work](int finished, int) { work.progress.at(finished); };
    Exploration exploration(work, estimate, checkpoint, results);
    // Of parameters that are held there is nothing to explore.
    const auto wanted = [&](const ParameterChoice& choice) {
        return choice.any() && (choice.all || !chosen(choice, parameters).empty());
    };
    if (wanted(job.profile))
        exploration.unknowns("profile", chosen(job.profile, parameters), results.profiles, [&] {
            estimator::ProfileOptions profile;
            profile.names = chosen(job.profile, parameters);
            profile.progress = progress;
            return estimator::profiles(parameters, residuals, tilted, estimate, profile);
        });
    if (wanted(job.marginals))
        exploration.unknowns("marginals", chosen(job.marginals, parameters), results.marginals, [&] {
            estimator::MarginalOptions marginal;
            marginal.names = chosen(job.marginals, parameters);
            marginal.progress = progress;
            return estimator::marginals(parameters, residuals, tilted, estimate, marginal);
        });
    if (job.intervals.bootstrap > 0)
        exploration.bootstrap(job.intervals, [&](const estimator::BootstrapOptions& asked) {
            return estimator::bootstrap(parameters, residuals, derived, quiet, estimate, asked);
        });
    if (job.sample.draws > 0)
        exploration.sample(job.sample, [&](const estimator::SampleOptions& sample) {
            return estimator::sample_posterior(parameters, residuals, derived, tilted, estimate, sample);
        });
}

LogEvidence evidence_of(const Job& job, const std::vector<estimator::FreeParameter>& parameters,
                        const std::vector<const estimator::Residual*>& residuals,
                        const estimator::EstimateOptions& options, const estimator::Estimate& estimate) {
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
