// SPDX-License-Identifier: Apache-2.0
/// \file
/// What every fuzz target shares. A target is a file with LLVMFuzzerTestOneInput(); libFuzzer calls
/// it in the preset `asan-ubsan`, replay_main.cpp everywhere else.
#pragma once

#include "rayloom/core/error.h"

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <new>

extern "C" {
int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
/// Targets that know the structure of their input change it themselves; weak elsewhere.
std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                    unsigned seed);
/// libFuzzer's own changes; absent elsewhere.
__attribute__((weak)) std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size,
                                                   std::size_t max_size);
}

namespace rayloom::fuzz
{

/// Runs `body`; typed errors and memory that ran out are answers, everything else is a find.
template <class Body>
void answer(const Body& body)
{
    try {
        body();
    } catch (const Error& e) {
        if (e.exit_code() != 70 && *e.what() != '\0') return;
        std::fprintf(stderr, "not a typed error: %s\n", e.what());
        std::abort();
    } catch (const std::bad_alloc&) {
    }
}

} // namespace rayloom::fuzz
