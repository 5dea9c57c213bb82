#pragma once

#include <memory>
#include <stdexcept>

#include "estimator/ranks/ranks.hpp"

namespace orbid::apps {

/// What a plug-in gives that makes ranks: orbid-mpi.so has one function of C, `orbid_rank_plugin`, that returns this.
struct RankPlugin {
    static constexpr int current = 1;

    int version;                  ///< of this struct and of Ranks; always the first member
    const char* program_version;  ///< of the orbid that it was built with
    /// The ranks of this program; called once. The object must be destroyed before the program ends normally.
    estimator::Ranks* (*ranks)();
};

using RankPluginEntry = const RankPlugin* (*)();
inline constexpr const char* rank_plugin_entry = "orbid_rank_plugin";

/// MPI cannot be used; what() says why and what to do.
class NoMpi : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/// This program was started as one of several by mpiexec or srun, as their environment variables say. One of one
/// counts, too.
[[nodiscard]] bool under_mpi();

/// Initialises MPI by the plug-in, which is looked for in the folder $ORBID_PLUGINS and in the folder orbid beside the
/// library. Only for programs that under_mpi(), and once: MPI cannot be initialised again. Rank 0 exchanges messages
/// with all others, and they with none but rank 0: anything else is a std::logic_error. The others ignore SIGINT and
/// SIGTERM from now on, which rank 0 answers for all.
///
/// The destructor ends MPI, when it has told the others and they have ended too. After an exception that passes it,
/// MPI_Abort ends all ranks when this one exits, so that what is still printed appears.
/// @throws NoMpi when the plug-in is missing, was built for another version or another MPI than the one that started
/// the program.
[[nodiscard]] std::unique_ptr<estimator::Ranks> mpi_ranks();

}  // namespace orbid::apps
