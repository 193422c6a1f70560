    // The end of bench.sv for test_devices.py, which puts this text in place of its `endmodule`. It counts the accesses to the
    // memories of the core, apart from loading and cleaning, and writes the counts to the file COUNTS_FILE when the class is
    // answered: first reads, then writes, in the order of the declarations.
    integer charge_reads = 0, state_reads = 0, buffer_reads = 0, synapse_reads = 0, axon_reads = 0;
    integer charge_writes = 0, state_writes = 0, buffer_writes = 0, queue_writes = 0;
    integer counts_file;
    wire counting = !core.clear && !load_valid;
    always @(posedge clk) begin
        if (counting) begin
            charge_reads <= charge_reads + core.banks[0].in_turn.charges.charges.read + core.banks[1].in_turn.charges.charges.read;
            state_reads <= state_reads + core.compartments.valid2;  // a read in cycle 0, of a number that is a compartment
            buffer_reads <= buffer_reads + (core.buffer.marking || core.buffer.next_word);
            synapse_reads <= synapse_reads + (core.deliver.valid2 && core.deliver.banks[0].used)
                + (core.deliver.valid2 && core.deliver.banks[1].used);
            axon_reads <= axon_reads + core.deliver.axons.read;
            charge_writes <= charge_writes + core.banks[0].in_turn.charges.charges.write + core.banks[1].in_turn.charges.charges.write;
            state_writes <= state_writes + core.compartments.states.write;
            buffer_writes <= buffer_writes + core.buffer.bitmap.write;
            queue_writes <= queue_writes + core.spikes.places.write;
        end
        if (answer_valid) begin
            counts_file = $fopen("COUNTS_FILE", "w");
            $fwrite(counts_file, "%0d %0d %0d %0d %0d\n", charge_reads, state_reads, buffer_reads, synapse_reads, axon_reads);
            $fwrite(counts_file, "%0d %0d %0d %0d\n", charge_writes, state_writes, buffer_writes, queue_writes);
            $fclose(counts_file);
        end
    end
endmodule
